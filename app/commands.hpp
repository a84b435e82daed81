#pragma once
// The subcommands. Each one receives the words of its command line and returns the exit code.

#include <string>
#include <vector>

namespace bromwich::app {

enum ExitCode : int { exit_solved = 0, exit_bad_input = 2, exit_not_solved = 3 };

/// Words as typed; empty = not given.
struct GoalArguments {
  std::string quantity, scheme, adjoint, weights, marking, cycles, first_steps;
};

struct SolveArguments {
  std::vector<std::string> words, settings;
  std::string method = "auto", backend = "auto";
  std::string states, tolerance, tolerance_x, tolerance_y, absolute_tolerance, max_steps, max_seconds, steps,
      iteration_tolerance, nodes, threads, at, columns, out, switches, report, checkpoint, checkpoint_every, restart;
  std::string periodic;      ///< of a netlist: auto, or a period
  std::string command_line;  ///< as typed, for the files that are written
  std::string log_level = "off";
  GoalArguments goal;
  bool json = false, print_template = false, print_schema = false, energies = false, event_location = false,
       no_confirm = false;
};

struct BenchArguments {
  std::vector<std::string> words, settings;
  std::string steps, threads, out, backend, siconos;
  bool quick = false;
};

struct PlotArguments {
  std::vector<std::string> results;
  std::string summary, out;
};

struct FitArguments {
  std::vector<std::string> words, settings;
  std::string data, free, method, steps, threads, periodic, out, plot;
  bool json = false;
};

struct ResponseArguments {
  std::vector<std::string> words, settings;
  std::string columns, source, frequencies, periodic, threads, out, report;
  bool json = false;
};

struct DerivativeArguments {
  std::vector<std::string> words, settings;
  std::string by, columns, at, method, steps, tolerance, threads, out;
  bool located = false, json = false;
};

struct CheckArguments {
  std::vector<std::string> words, settings;
  std::string method = "auto", backend = "auto";
  std::string steps, states;
  bool json = false;
};

/// The whole command: prepares the process, reads the command line, returns the exit code. Called once a process.
int command(int argc, char** argv);

/// All built-in scenes, or the parameters of one scene, one a line.
int run_scenes(const std::string& scene);
int run_solve(const SolveArguments& arguments);
int run_bench(const BenchArguments& arguments);
int run_plot(const PlotArguments& arguments);
int run_check(const CheckArguments& arguments);
int run_response(const ResponseArguments& arguments);
int run_derivative(const DerivativeArguments& arguments);
int run_fit(const FitArguments& arguments);
int run_info();

/// "baselines    ...": one line per benchmark, for the help.
std::string bench_list();

/// Writes to standard output; throws Error if that fails (for example redirected to a full disk).
void print(const std::string& text);

}  // namespace bromwich::app
