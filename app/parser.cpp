#include "app/parser.hpp"

#include "app/arguments.hpp"
#include "app/text.hpp"

#include <CLI/CLI.hpp>

namespace bromwich::app {

namespace {

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

/// What `solve` and `check` have in common.
template <class Arguments>
void add_scene(CLI::App* command, Arguments& a, const std::string& what) {
  command->add_option("SCENE", a.words, what)->option_text(" ");
  add_settings(command, a.settings);
  add_word(command, "--method", a.method, "NAME",
           join(method_names()) + "; default: auto; nonlinear systems: march, iteration, newton or pointwise");
  add_word(command, "--backend", a.backend, "NAME", "auto (default), cpu or cuda");
}

void add_tolerances(CLI::App* command, SolveArguments& a) {
  add_word(command, "--tol", a.tolerance, "EPS",
           "refine the grid until the estimated error of every component of y and of the selected states is below EPS "
           "times its largest value; where y may jump, of its mean over [0, t]; default, without --steps: that of the "
           "scene, "
           "or 1e-3 where it states neither");
  add_word(command, "--tol-x", a.tolerance_x, "EPS",
           "the same for the states; without the other two: for all states and not for y");
  add_word(command, "--tol-y", a.tolerance_y, "EPS", "the same for y; without the other two: for y only");
  add_word(command, "--atol", a.absolute_tolerance, "EPS",
           "absolute error, added to the relative one, in the units of the scene");
  add_word(command, "--max-steps", a.max_steps, "J", "with a tolerance: largest number of steps; default 1048576");
  add_word(command, "--max-seconds", a.max_seconds, "S", "with a tolerance: no further grid after this time");
}

void add_files_of_results(CLI::App* command, SolveArguments& a) {
  add_word(
      command, "--out", a.out, "FILE",
      "write t, y and the selected states: .csv, .h5 (HDF5, for xarray), .npz (NumPy), or .vtkhdf (ParaView, scenes "
      "on a grid)");
  add_word(
      command, "--columns", a.columns, "LIST",
      "with --out FILE.csv: columns to write: y, w, trace (N x), x (all states), contact (friction and state of each), "
      "or single ones by name, y0,w0,x2; default: y and the selected states, and contact");
  add_word(command, "--at", a.at, "LIST", "with --out: rows at these times, 0.1,0.25, instead of the time points");
  add_word(command, "--switches", a.switches, "FILE.csv", "write when constraints become active and inactive");
}

void add_goal_options(CLI::App* command, GoalArguments& a) {
  add_word(
      command, "--quantity", a.quantity, "I",
      "method goal: loc (default), glob or loc+RHO, the violation of the energy balance step by step, over all time, "
      "or with RHO times the integral of |x|^2; file (default if the scene file has [quantity]): that quantity");
  add_word(command, "--scheme", a.scheme, "NAME", "method goal: euler (default), midpoint or exponential");
  add_word(command, "--adjoint", a.adjoint, "NAME",
           "method goal: exact (default), substitution, scan, doubling, jacobi:K");
  add_word(command, "--weights", a.weights, "NAME",
           "method goal: local (default), interpolated or global weights of the residual");
  add_word(command, "--marking", a.marking, "SHARE",
           "method goal: halve the cells with this share of the error; auto (default): the most economical number of "
           "cells; divide: equal blocks, each divided into cells according to its share");
  add_word(command, "--cycles", a.cycles, "N", "method goal: refinements; default: until --steps or --tol");
  add_word(command, "--first-steps", a.first_steps, "J", "method goal: steps of the first grid; default 20");
}

void add_checkpoints(CLI::App* command, SolveArguments& a) {
  add_word(command, "--checkpoint", a.checkpoint, "FILE.h5",
           "solve in parts of time, and write what a restart needs; methods march, euler, contour and multigrid");
  add_word(command, "--checkpoint-every", a.checkpoint_every, "S", "seconds between checkpoints; default 60");
  add_word(
      command, "--restart", a.restart, "FILE.h5",
      "continue the run of this checkpoint, and its --out if that is .h5 or .vtkhdf; of a sweep on several ranks: the "
      "folder FILE.parts that it has left");
}

}  // namespace

CLI::App* add_command(CLI::App& app, SolveArguments& a) {
  CLI::App* command = app.add_subcommand("solve", "solve a scene");
  add_scene(command, a, "a scene that 'bromwich scenes' lists, a file .toml, or a netlist .cir");
  add_word(command, "--steps", a.steps, "J",
           "time steps, with --tol of the first grid; default: those of the scene, if it states no tolerance");
  add_tolerances(command, a);
  add_word(command, "--iteration-tol", a.iteration_tolerance, "EPS",
           "stop iterating at this change of y, relative to max(1,|y|); default 1e-12, or a thousandth of --tol");
  add_word(command, "--nodes", a.nodes, "P", "method contour-literal: P + 1 nodes for each time point; default 25");
  add_word(command, "--threads", a.threads, "N", "threads; default: all cores");
  add_word(command, "--states", a.states, "LIST",
           "state components to write: none, all, 0,3,7 or their names; default: the scene's, or none");
  add_files_of_results(command, a);
  add_word(
      command, "--periodic", a.periodic, "T",
      "of a netlist: its periodic state with this period, or auto, the least common one of its sources; prints mean, "
      "RMS, ripple and THD of all outputs, powers, losses and efficiency");
  command->add_flag("--event-location", a.event_location,
                    "method galerkin: solve again with nodes at the switches of the active sets");
  command->add_flag("--no-confirm", a.no_confirm,
                    "solve once: never again with other steps where something speaks against the result");
  add_goal_options(command, a.goal);
  command->add_flag("--energies", a.energies,
                    "with --out: columns energy, supplied_power, dissipated_power at t, and supplied, dissipated, "
                    "violation of the step");
  add_checkpoints(command, a);
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

CLI::App* add_command(CLI::App& app, CheckArguments& a) {
  CLI::App* command = app.add_subcommand("check", "say what is known of a scene before it is solved, or of a result");
  add_scene(command, a, "a scene that 'bromwich scenes' lists, a file .toml, or a result .h5, .npz, .vtkhdf or .csv");
  add_word(command, "--steps", a.steps, "J", "time steps; default: those of the scene, or its tolerance");
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

CLI::App* add_command(CLI::App& app, PlotArguments& a) {
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

CLI::App* add_command(CLI::App& app, ResponseArguments& a) {
  CLI::App* command = app.add_subcommand("response", "small signals of a netlist about its periodic state");
  command->add_option("SCENE", a.words, "a netlist .cir")->option_text(" ");
  add_settings(command, a.settings);
  add_word(command, "--columns", a.columns, "LIST",
           "V(out), I(L1), ...: to the AC of the sources, or to --source; gain(Vz): of the loop that a source of 0 V "
           "stands in; impedance(out), impedance(a,b); default: all voltages");
  add_word(command, "--source", a.source, "NAME", "the responses to 1 V or 1 A of this source, in place of all AC");
  add_word(command, "--frequencies", a.frequencies, "LIST",
           "'dec 20 100 100k' as .ac has it, also oct and lin, or 100,1k,10k; default: those of .ac");
  add_word(command, "--periodic", a.periodic, "T", "the period; default: the least common one of the sources");
  add_word(command, "--threads", a.threads, "N", "threads; default: all cores");
  add_word(command, "--out", a.out, "FILE.csv", "write frequency and of each column abs(...) and phase(...), degrees");
  add_word(command, "--report", a.report, "FILE.html", "write a page with sizes in dB and phases over frequency");
  command->add_flag("--json", a.json, "print one JSON object instead of the lines");
  command->footer(
      "Switches move with the signal: no averaged model is made. Of a gain the margins of phase and gain are printed.\n"
      "Examples:\n"
      "  bromwich response buck.cir --source Vin --frequencies 'dec 20 100 50k' --report bode.html\n"
      "  bromwich response loop.cir --columns 'gain(Vz),impedance(out)' --out loop.csv && bromwich plot loop.csv\n"
      "Exit code: 0 found, 2 bad input, 3 the periodic state is not solved.");
  return command;
}

/// How a command that is not about solving solves its scene.
template <class Arguments>
void add_solve(CLI::App* command, Arguments& a) {
  add_word(command, "--method", a.method, "NAME", join(method_names()) + "; default: auto");
  add_word(command, "--steps", a.steps, "J", "time steps; default: those of the scene, or its tolerance");
  add_word(command, "--threads", a.threads, "N", "threads; default: all cores");
}

CLI::App* add_command(CLI::App& app, DerivativeArguments& a) {
  CLI::App* command = app.add_subcommand("derivative", "how a solution changes with parameters of its scene");
  command->add_option("SCENE", a.words, "a scene that 'bromwich scenes' lists, or a file .toml")->option_text(" ");
  add_settings(command, a.settings);
  add_word(command, "--by", a.by, "LIST", "parameters of the scene, R,C");
  add_word(command, "--columns", a.columns, "LIST",
           "of y, w, x, or single ones by name, y0,w0,x2; default: y, and the states of scenes with at most 64");
  add_word(command, "--at", a.at, "LIST", "times, 0.1,0.25; default: T, in --out all time points");
  add_solve(command, a);
  add_word(command, "--tol", a.tolerance, "EPS", "refine the grid as 'bromwich solve --tol' does");
  add_word(command, "--out", a.out, "FILE.csv", "write the columns, and beside each its derivatives");
  command->add_flag("--located", a.located, "with located switches, also where y is continuous");
  command->add_flag("--json", a.json, "print one JSON object instead of the table");
  command->footer(
      "Exact derivatives with respect to the data of the scene, which are differentiated by central differences. Where "
      "y or\n"
      "x may jump, switches are located. If the scene has a [quantity], the row I is that quantity.\n"
      "Examples:\n"
      "  bromwich derivative my.toml --by R,C\n"
      "  bromwich derivative my.toml --by R --columns v_C --at 1e-3,2e-3 --out curves.csv\n"
      "Exit code: 0 found, 2 bad input, 3 not solved or not differentiable here.");
  return command;
}

CLI::App* add_command(CLI::App& app, FitArguments& a) {
  CLI::App* command = app.add_subcommand("fit", "fit parameters of a scene to measured values");
  command->add_option("SCENE", a.words, "a scene that 'bromwich scenes' lists, a file .toml or a netlist .cir")
      ->option_text(" ");
  add_settings(command, a.settings);
  add_word(command, "--data", a.data, "FILE.csv",
           "measured values: header t,x0,y0,..., or t,V(out),..., an empty field is no datum");
  add_word(command, "--free", a.free, "LIST", "parameters to fit, with bounds if any: R,C=1e-7:1e-5");
  add_solve(command, a);
  add_word(command, "--periodic", a.periodic, "T", "of a netlist: its periodic state with this period, or auto");
  add_word(command, "--out", a.out, "FILE.csv", "write the fitted values beside the measured ones");
  add_word(command, "--plot", a.plot, "FILE.svg", "draw the fitted curves with the measured values");
  command->add_flag("--json", a.json, "print one JSON object instead of the lines");
  command->footer(
      "Least squares by Levenberg and Marquardt's method; starts from the values of the scene, or of --set.\n"
      "Examples:\n"
      "  bromwich fit my.toml --data measured.csv --free R --method march\n"
      "  bromwich fit my.toml --data measured.csv --free R=10:1e4,C=0: --set R=300 --out fitted.csv\n"
      "  bromwich fit buck.cir --data scope.csv --free L,C,ESR --periodic auto\n"
      "Exit code: 0 converged, 2 bad input, 3 not converged.");
  return command;
}

CLI::App* add_command(CLI::App& app, BenchArguments& a) {
  CLI::App* command = app.add_subcommand("bench", "measure and compare methods");
  command->add_option("NAME", a.words, "a benchmark, and a scene if it uses one")->option_text("[SCENE]");
  add_settings(command, a.settings);
  add_word(command, "--steps", a.steps, "J", "time steps; default: the benchmark's own sizes");
  add_word(command, "--threads", a.threads, "N", "threads; default: all cores");
  add_word(command, "--out", a.out, "FILE.json", "write the measurements with machine, compiler and commit");
  add_word(command, "--backend", a.backend, "NAME",
           "dual, multigrid, signorini3d: measure on cpu or on cuda alone; default: both, where a device is found");
  command->add_flag("--quick", a.quick, "smallest size, fewer repeats, coarser reference");
  add_word(command, "--siconos", a.siconos, "PROGRAM",
           "stability: also by Siconos, through bench/peers/siconos_loop.cpp compiled as PROGRAM");
  command->footer("Benchmarks:\n" + bench_list() +
                  "Examples:\n"
                  "  bromwich bench baselines --quick\n"
                  "  bromwich bench baselines signorini --set Q=255 --steps 400 --threads 1 --out baselines.json");
  return command;
}

}  // namespace bromwich::app
