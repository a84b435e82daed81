#pragma once
// Sources f and g as Python states them.

#include "bromwich/memory.hpp"
#include "callable.hpp"
#include "core/base/time_function.hpp"

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace bromwich::python {

/// A function of time, and what is known of its jumps and kinks.
struct Source {
  TimeFunction function;
  Index width = 0;                  ///< values it writes
  std::vector<double> breakpoints;  ///< increasing
  bool breakpoints_are_all = false;
  std::vector<Kept> callables = {};   ///< what the function calls
  std::function<void()> forget = {};  ///< drops values that it has kept, before a solve; may be empty
  /// With the lock held: (word, arguments) of the function that makes it again.
  std::function<nb::object()> state = {};
};

Source constant_source(const Vector& value);

/// Linear between the rows of `values`, which belong to `times`; two rows of equal time are a jump. `kinks`: the
/// function is that, with a kink at every row; otherwise the rows are values of a smooth one.
Source table_source(const Vector& times, const RowMatrix& values, bool kinks);

/// A Python function t -> array of `width` values, and where there is one its form for many times at once,
/// array of k times -> array k x width; None otherwise. Both are called from the thread that solves, and what they
/// raise leaves `solve`.
Source python_source(const Kept& one, const Kept& many, Index width, double T);

/// One expression of t and the parameters per value (docs/scene-files.md).
Source expression_source(const std::vector<std::string>& texts, const std::map<std::string, double>& parameters,
                         double T, const std::string& name);

/// A condition of a memory, a text of the states, y and t, and the times at which what it says of t may jump.
struct ReadCondition {
  Memory::Condition condition;
  std::vector<double> breakpoints;
  bool breakpoints_are_all = false;
};

/// Reads the conditions of a scene. `x` and `y`: names of the components, or none.
class ConditionReader {
 public:
  ConditionReader(Index states, const std::vector<std::string>& x, Index constraints, const std::vector<std::string>& y,
                  const std::vector<std::string>& memories, const std::map<std::string, double>& parameters, double T);
  ReadCondition read(const std::string& text, const std::string& name) const;
  /// The number of a state by its name; -1: there is none.
  Index state(const std::string& name) const;

 private:
  struct Parts;
  std::shared_ptr<const Parts> parts_;
};

/// f and g together: the times of both.
std::vector<double> merged(const std::vector<double>& a, const std::vector<double>& b);

}  // namespace bromwich::python
