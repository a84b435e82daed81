#pragma once
// Conversion of command-line words to values. Every function throws Error naming the argument, the value found and the
// remedy; nothing is corrected silently.

#include "app/commands.hpp"
#include "catalogue/catalogue.hpp"
#include "core/solve/solve.hpp"

#include <optional>
#include <string>
#include <vector>

namespace bromwich::app {

inline constexpr long long max_steps = 1LL << 24;
inline constexpr int max_threads = 4096;

/// A whole number from 1 to `limit`, also "1e6".
Index parse_steps(const std::string& word, long long limit = max_steps);
int parse_threads(const std::string& word);
/// The given options of error control, or those of with_defaults, behind the other options; `of_states`: the default
/// tolerance is one of the states alone.
void parse_error_control(const SolveArguments&, Options& options, const Scene&, bool of_states);
/// A positive number of seconds.
double parse_seconds(const std::string& argument, const std::string& word);
/// A number strictly between 0 and 1.
double parse_iteration_tolerance(const std::string& word);
/// P of contour-literal; refused with other methods.
Index parse_nodes(const std::string& word, Method method);
Method parse_method(const std::string& word);
/// "auto", "contour", ...: the words that parse_method accepts.
std::vector<std::string> method_names();

/// "all", "none" or a list "0,3,7" or "v,i" of components; errors name `argument`.
void parse_states(const std::string& argument, const std::string& word, const Scene& scene, Options& options);

/// Times from 0 to T, "0.1,0.25"; T may be written with fewer digits than it has.
std::vector<double> parse_times(const std::string& word, double T);

/// key=value, each key once; a value may be an expression of the keys before it, "2*pi/3", and of the parameters that
/// the scene of this name has with them.
ParameterValues parse_settings(const std::vector<std::string>& words, const std::string& scene = "");

/// The positional words of a command: names, and more key=value words after a --set ("--set Q=39 T=2").
struct Words {
  std::vector<std::string> names;
  std::vector<std::string> settings;
};
/// The one SCENE of a command.
std::string scene_name(const Words&);
Words split_words(const std::vector<std::string>& words, const std::vector<std::string>& settings);

}  // namespace bromwich::app
