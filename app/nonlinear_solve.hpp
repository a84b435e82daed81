#pragma once
// `bromwich solve` for files with a section [nonlinear]: options, the solve, and what is said of it.

#include "app/commands.hpp"
#include "app/output_json.hpp"
#include "app/scene_choice.hpp"
#include "core/result/switching.hpp"
#include "nonlinear/nonlinear_output.hpp"

#include <vector>

namespace bromwich::app {

/// "auto", "march", "iteration", "newton" or "pointwise". Throws Error for another word.
NonlinearMethod parse_nonlinear_method(const std::string& word);

/// Those of `solve` that apply. Throws Error for an argument that does not apply to nonlinear systems. `options`: what
/// the words of all solves mean.
NonlinearOptions nonlinear_options(const SolveArguments&, const Options& options);

/// A nonlinear result as `solve` writes it.
class NonlinearRun {
 public:
  NonlinearRun(const SceneChoice&, Backend&, const NonlinearOptions&);

  /// As a result of the linear part; its trace is N x + gamma.
  const Result& result() const { return as_linear_; }
  std::string method() const { return to_string(result_.method); }
  Result at(const std::vector<double>& times) const;
  /// With the difference from those of half the steps as an error.
  std::vector<Switch> switches() const;
  Json json() const;

 private:
  const SceneChoice& choice_;
  Backend& backend_;
  NonlinearOptions options_;
  NonlinearResult result_;
  Result as_linear_;
};

/// The states of `components` alone.
void keep_states(Result&, const std::vector<Index>& components);

/// Lines of `check`: what phi and gamma are at t = 0, and which methods take them.
std::vector<std::string> nonlinear_facts(const NonlinearScene&, Index steps);

}  // namespace bromwich::app
