// The `bromwich` command: declares the command line and turns every failure into one line and an exit code.

#include "app/arguments.hpp"
#include "app/commands.hpp"
#include "app/interaction.hpp"
#include "app/text.hpp"
#include "core/base/error.hpp"
#include "core/build_info.hpp"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <exception>
#include <new>
#include <sstream>

#if defined(__GLIBC__)
#include <malloc.h>
#endif

namespace bromwich::app {

namespace {

const std::vector<std::string> commands{"scenes", "solve", "check", "plot", "bench", "info"};

int refuse(const std::string& message) {
  complain(message);
  return exit_bad_input;
}

/// The parser leaves all values as words: the later checks name the value found and the remedy.
CLI::Option* add_word(CLI::App* command, const std::string& name, std::string& word, const char* unit,
                      const std::string& help) {
  const CLI::Validator not_empty(
      [](std::string& text) { return std::string(text.empty() ? "found an empty value; give one" : ""); }, "");
  return command->add_option(name, word, help)->check(not_empty)->type_name(unit)->option_text(unit);
}

void add_settings(CLI::App* command, std::vector<std::string>& settings) {
  command
      ->add_option("--set", settings,
                   "set parameters of the scene, or T; a number or an expression such as 2*pi; may be repeated")
      ->allow_extra_args(false)
      ->type_name("key=value")
      ->option_text("key=value ...");
}

CLI::App* add_solve(CLI::App& app, SolveArguments& a) {
  CLI::App* command = app.add_subcommand("solve", "solve a scene");
  command->add_option("SCENE", a.words, "a scene that 'bromwich scenes' lists, or a file .toml")->option_text(" ");
  add_settings(command, a.settings);
  add_word(command, "--method", a.method, "NAME", join(method_names()) + "; default: auto");
  add_word(command, "--backend", a.backend, "NAME", "auto (default), cpu or cuda");
  add_word(command, "--steps", a.steps, "J", "time steps, with --tol of the first grid; default: the scene's own");
  add_word(command, "--tol", a.tolerance, "EPS",
           "refine the grid until the estimated error of every component of y and of the selected states is below EPS "
           "times its largest value");
  add_word(command, "--tol-x", a.tolerance_x, "EPS",
           "the same for the states; without the other two: for all states and not for y");
  add_word(command, "--tol-y", a.tolerance_y, "EPS", "the same for y; without the other two: for y only");
  add_word(command, "--atol", a.absolute_tolerance, "EPS",
           "absolute error, added to the relative one, in the units of the scene");
  add_word(command, "--max-steps", a.max_steps, "J", "with a tolerance: largest number of steps; default 1048576");
  add_word(command, "--max-seconds", a.max_seconds, "S", "with a tolerance: no further grid after this time");
  add_word(command, "--iteration-tol", a.iteration_tolerance, "EPS",
           "stop iterating at this change of y, relative to max(1,|y|); default 1e-12, or a thousandth of --tol");
  add_word(command, "--threads", a.threads, "N", "threads; default: all cores");
  add_word(command, "--states", a.states, "LIST",
           "state components to write: none, all, 0,3,7 or their names; default: the scene's, or none");
  add_word(
      command, "--out", a.out, "FILE",
      "write t, y and the selected states: .csv, .h5 (HDF5, for xarray), .npz (NumPy), or .vtkhdf (ParaView, scenes "
      "on a grid)");
  add_word(
      command, "--columns", a.columns, "LIST",
      "with --out FILE.csv: columns to write: y, w, trace (N x), x (all states), or single ones by name, y0,w0,x2; "
      "default: y and the selected states");
  add_word(command, "--at", a.at, "LIST", "with --out: rows at these times, 0.1,0.25, instead of the time points");
  add_word(command, "--switches", a.switches, "FILE.csv", "write when constraints become active and inactive");
  command->add_flag("--event-location", a.event_location,
                    "method galerkin: solve again with nodes at the switches of the active sets");
  add_word(
      command, "--quantity", a.goal.quantity, "I",
      "method goal: loc (default), glob or loc+RHO, the violation of the energy balance step by step, over all time, "
      "or with RHO times the integral of |x|^2; file (default if the scene file has [quantity]): that quantity");
  add_word(command, "--scheme", a.goal.scheme, "NAME", "method goal: euler (default), midpoint or exponential");
  add_word(command, "--adjoint", a.goal.adjoint, "NAME",
           "method goal: exact (default), substitution, scan, doubling, jacobi:K");
  add_word(command, "--weights", a.goal.weights, "NAME",
           "method goal: local (default), interpolated or global weights of the residual");
  add_word(command, "--marking", a.goal.marking, "SHARE",
           "method goal: halve the cells with this share of the error; auto (default): the most economical number of "
           "cells; divide: equal blocks, each divided into cells according to its share");
  add_word(command, "--cycles", a.goal.cycles, "N", "method goal: refinements; default: until --steps or --tol");
  add_word(command, "--first-steps", a.goal.first_steps, "J", "method goal: steps of the first grid; default 20");
  command->add_flag("--energies", a.energies,
                    "with --out: columns energy, supplied_power, dissipated_power at t, and supplied, dissipated, "
                    "violation of the step");
  add_word(command, "--checkpoint", a.checkpoint, "FILE.h5",
           "solve in parts of time, and write what a restart needs; methods march and euler");
  add_word(command, "--checkpoint-every", a.checkpoint_every, "S", "seconds between checkpoints; default 60");
  add_word(command, "--restart", a.restart, "FILE.h5",
           "continue the run of this checkpoint, and its --out if that is .h5 or .vtkhdf");
  add_word(command, "--report", a.report, "FILE.html",
           "write a page with the curves of y, w and the selected states, active sets, convergence, errors and times");
  add_word(command, "--log-level", a.log_level, "LEVEL",
           "say on standard error what the solve decides: off (default), warning, info or debug");
  command->add_flag("--json", a.json, "print one JSON object instead of the summary");
  command->add_flag("--template", a.print_template, "print a commented scene file to start from, and exit");
  command->add_flag("--schema", a.print_schema, "print the JSON Schema of scene files, for editors, and exit");
  command->footer(
      "Examples:\n"
      "  bromwich solve signorini\n"
      "  bromwich solve --template > my.toml && bromwich solve my.toml --set R=500\n"
      "  bromwich solve my.toml --set T=2*pi --columns y,w,x --out y.csv\n"
      "  bromwich solve signorini --set Q=127 --steps 1000 --method march --out y.csv\n"
      "  bromwich solve signorini --tol 1e-5\n"
      "  bromwich solve signorini --method contour --iteration-tol 1e-8 --json\n"
      "  bromwich solve ph-toy --method goal --steps 400 --states all --energies --out x.csv\n"
      "Exit code: 0 solved, 2 bad input, 3 any other status (the valid part is still written).");
  return command;
}

CLI::App* add_check(CLI::App& app, CheckArguments& a) {
  CLI::App* command = app.add_subcommand("check", "say what is known of a scene before it is solved, or of a result");
  command
      ->add_option("SCENE", a.words,
                   "a scene that 'bromwich scenes' lists, a file .toml, or a result .h5, .npz or .csv")
      ->option_text(" ");
  add_settings(command, a.settings);
  add_word(command, "--method", a.method, "NAME", join(method_names()) + "; default: auto");
  add_word(command, "--backend", a.backend, "NAME", "auto (default), cpu or cuda");
  add_word(command, "--steps", a.steps, "J", "time steps; default: the scene's own");
  add_word(command, "--states", a.states, "LIST", "state components to write: none, all or 0,3,7");
  command->add_flag("--json", a.json, "print one JSON object instead of the lines");
  command->footer(
      "Prints sizes, the class of M, the spectrum of A, sources, the methods that would be tried with their memory "
      "and\n"
      "time, and warnings.\n"
      "Examples:\n"
      "  bromwich check my.toml\n"
      "  bromwich check signorini --set Q=511 --steps 4096 --json\n"
      "Of a result it prints the status, what was checked, and whether y and w of the rows are complementary.\n"
      "  bromwich check y.h5\n"
      "Exit code: 0 nothing speaks against a solve, or the result is solved; 2 bad input, or the scene will not be "
      "solved\n"
      "(one line says why); 3 the result is not solved.");
  return command;
}

CLI::App* add_plot(CLI::App& app, PlotArguments& a) {
  CLI::App* command = app.add_subcommand("plot", "draw a result as an HTML page");
  command
      ->add_option("RESULT", a.results, "a file that 'bromwich solve SCENE --out FILE' has written: .csv, .h5 or .npz")
      ->option_text(" ");
  add_word(
      command, "--summary", a.summary, "FILE.json",
      "of a file .csv, what 'bromwich solve SCENE --json' has printed: adds method, certificates, errors and times");
  add_word(command, "--out", a.out, "FILE.html", "the page; default: RESULT with the extension .html");
  command->footer(
      "The page stands alone: no network, no scripts. 'bromwich solve SCENE --report FILE.html' writes it at once.\n"
      "Example:\n"
      "  bromwich solve signorini --out y.h5\n"
      "  bromwich plot y.h5\n"
      "  bromwich solve signorini --out y.csv --json > y.json\n"
      "  bromwich plot y.csv --summary y.json");
  return command;
}

CLI::App* add_bench(CLI::App& app, BenchArguments& a) {
  CLI::App* command = app.add_subcommand("bench", "measure and compare methods");
  command->add_option("NAME", a.words, "a benchmark, and a scene if it uses one")->option_text("[SCENE]");
  add_settings(command, a.settings);
  add_word(command, "--steps", a.steps, "J", "time steps; default: the benchmark's own sizes");
  add_word(command, "--threads", a.threads, "N", "threads; default: all cores");
  add_word(command, "--out", a.out, "FILE.json", "write the measurements with machine, compiler and commit");
  command->add_flag("--quick", a.quick, "smallest size, fewer repeats, coarser reference");
  add_word(command, "--siconos", a.siconos, "PROGRAM",
           "stability: also by Siconos, through bench/peers/siconos_loop.cpp compiled as PROGRAM");
  command->footer("Benchmarks:\n" + bench_list() +
                  "Examples:\n"
                  "  bromwich bench baselines --quick\n"
                  "  bromwich bench baselines signorini --set Q=255 --steps 400 --threads 1 --out baselines.json");
  return command;
}

/// The parser only reports a missing command; this also names the word in its place.
void check_command(int argc, char** argv) {
  const std::string word = argc > 1 ? argv[1] : "";
  for (const std::string& name : commands)
    if (word == name) return;
  if (word == "-h" || word == "--help" || word == "--version") return;
  throw Error("command", argc > 1 ? fmt::format("found '{}'", word) + suggestion(word, commands) : "found none",
              fmt::format("begin with one of {}; 'bromwich --help' shows how", join(commands)));
}

/// The words as a shell takes them.
std::string command_line(int argc, char** argv) {
  std::string line = "bromwich";
  for (int i = 1; i < argc; ++i) {
    std::string word = argv[i];
    const bool plain = !word.empty() && word.find_first_not_of(
                                            "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
                                            "0123456789_-+=,./:@%") == std::string::npos;
    for (std::size_t at = 0; !plain && (at = word.find('\'', at)) != std::string::npos; at += 4)
      word.replace(at, 1, "'\\''");
    line += plain ? " " + word : " '" + word + "'";
  }
  return line;
}

/// The value found and the remedy, for a line that the parser rejects.
std::string explain(const CLI::App& app, const CLI::ParseError& error) {
  const auto used = app.get_subcommands();
  const CLI::App& command = used.empty() ? app : *used.front();
  const std::string remedy = fmt::format("see 'bromwich {}--help'", used.empty() ? "" : command.get_name() + " ");
  const auto extras = app.remaining(true);
  if (dynamic_cast<const CLI::ExtrasError*>(&error) == nullptr || extras.empty())
    return fmt::format("{}; {}", error.what(), remedy);
  std::vector<std::string> known;
  for (const CLI::Option* option : command.get_options())
    if (!option->get_lnames().empty()) known.push_back("--" + option->get_lnames().front());
  const std::string word = extras.front().substr(0, extras.front().find('='));
  return fmt::format("{}: is no argument of {}{}; {}", word, command.get_name(), suggestion(word, known), remedy);
}

int run(int argc, char** argv) {
  CLI::App app{
      "Solves linear complementarity systems (nonsmooth dynamics)\n"
      "  x' = A x + B y + f(t),  0 <= y  perpendicular to  w = N x + M y + g(t) >= 0\n"
      "for all time points at once by contour integrals, or by time stepping.",
      "bromwich"};
  app.get_formatter()->column_width(28);
  app.set_version_flag("--version", fmt::format("bromwich {}", build_info::version), "print the version and exit");
  app.require_subcommand(1);
  SolveArguments solve_arguments;
  CheckArguments check_arguments;
  PlotArguments plot_arguments;
  BenchArguments bench_arguments;
  const CLI::App* scenes = app.add_subcommand("scenes", "list the built-in scenes and their parameters");
  const CLI::App* solve = add_solve(app, solve_arguments);
  const CLI::App* check = add_check(app, check_arguments);
  const CLI::App* plot = add_plot(app, plot_arguments);
  const CLI::App* bench = add_bench(app, bench_arguments);
  app.add_subcommand("info", "print version, build, backends and device");
  app.footer(
      "Examples:\n"
      "  bromwich scenes\n"
      "  bromwich solve signorini --set Q=39 --steps 400 --out y.csv\n"
      "'bromwich COMMAND --help' explains a command.");

  check_command(argc, argv);
  solve_arguments.command_line = command_line(argc, argv);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) {  // --help and --version
      std::ostringstream out;
      app.exit(error, out, out);
      print(out.str());
      return exit_solved;
    }
    return refuse(explain(app, error));
  }
  if (scenes->parsed()) return run_scenes();
  if (solve->parsed()) return run_solve(solve_arguments);
  if (check->parsed()) return run_check(check_arguments);
  if (plot->parsed()) return run_plot(plot_arguments);
  return bench->parsed() ? run_bench(bench_arguments) : run_info();
}

}  // namespace

int guarded_main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const Error& error) {
    return refuse(error.what());
  } catch (const std::bad_alloc&) {
    return refuse(
        "memory: the problem does not fit into this machine's memory; use fewer --steps, --states or --threads, or a "
        "smaller scene");
  } catch (const std::exception& error) {
    return refuse(fmt::format("internal error: {}; please report it with the command line", error.what()));
  } catch (...) {
    return refuse("internal error: an unknown exception; please report it with the command line");
  }
}

int command(int argc, char** argv) {
  prepare_process();
#if defined(__GLIBC__)
  // Keeps freed memory for later tables over time: fresh pages cost more than the computations with them.
  mallopt(M_MMAP_MAX, 0);
  mallopt(M_TRIM_THRESHOLD, 1 << 30);
#endif
  return guarded_main(argc, argv);
}

}  // namespace bromwich::app
