// The `bromwich` command: calls the parser and turns every failure into one line and an exit code.

#include "app/commands.hpp"
#include "app/interaction.hpp"
#include "app/parser.hpp"
#include "app/ranks.hpp"
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

const std::vector<std::string> commands{"scenes",     "solve", "check", "plot", "response",
                                        "derivative", "fit",   "bench", "info"};

int refuse(const std::string& message) {
  complain(message);
  return exit_bad_input;
}

/// The parser only reports a missing command; this also names the word in its place.
void check_command(int argc, char** argv) {
  const std::string word = argc > 1 ? argv[1] : "";
  for (const std::string& name : commands)
    if (word == name) return;
  if (word == "-h" || word == "--help" || word == "--version") return;
  std::vector<std::string> known = commands;
  known.insert(known.end(), {"--help", "--version"});
  throw Error("command", argc > 1 ? fmt::format("found '{}'", word) + suggestion(word, known) : "found none",
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
  const std::string_view what = error.what();  // "--steps: 1 required J missing"
  if (const auto at = what.find(": 1 required "); at != std::string_view::npos && what.ends_with(" missing"))
    return fmt::format("{}: found no value; give one; {}", what.substr(0, at), remedy);
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
  ResponseArguments response_arguments;
  DerivativeArguments derivative_arguments;
  FitArguments fit_arguments;
  BenchArguments bench_arguments;
  std::string listed;
  CLI::App* scenes = app.add_subcommand("scenes", "list the built-in scenes, or the parameters of one scene");
  scenes->add_option("SCENE", listed, "a built-in scene or a file .toml: its parameters")->option_text(" ");
  const CLI::App* solve = add_command(app, solve_arguments);
  const CLI::App* check = add_command(app, check_arguments);
  const CLI::App* plot = add_command(app, plot_arguments);
  const CLI::App* response = add_command(app, response_arguments);
  const CLI::App* derivative = add_command(app, derivative_arguments);
  const CLI::App* fit = add_command(app, fit_arguments);
  const CLI::App* bench = add_command(app, bench_arguments);
  app.add_subcommand("info", "print version, build, backends and device");
  app.footer(
      "Examples:\n"
      "  bromwich scenes\n"
      "  bromwich solve signorini --set Q=39 --steps 400 --out y.csv\n"
      "'bromwich COMMAND --help' explains a command.");

  check_ranks();
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
  if (scenes->parsed()) return run_scenes(listed);
  if (solve->parsed()) return run_solve(solve_arguments);
  if (check->parsed()) return run_check(check_arguments);
  if (plot->parsed()) return run_plot(plot_arguments);
  if (response->parsed()) return run_response(response_arguments);
  if (derivative->parsed()) return run_derivative(derivative_arguments);
  if (fit->parsed()) return run_fit(fit_arguments);
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
