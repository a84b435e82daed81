#include "files/state_functions.hpp"

#include "files/expression.hpp"
#include "files/names.hpp"
#include "files/slope.hpp"

#include <algorithm>
#include <set>
#include <utility>

namespace bromwich {

namespace {

using In = const Eigen::Ref<const Vector>&;

/// A formula with the variables it uses, increasing.
struct Entry {
  Formula formula;
  std::vector<std::size_t> variables;
};

std::vector<std::size_t> used(const Formula& formula) {
  std::set<std::size_t> found;
  for (const Instruction& step : formula.program)
    if (step.operation == Operation::variable) found.insert(step.target);
  return {found.begin(), found.end()};
}

std::vector<double> joined(In x, In y) {
  std::vector<double> all(x.begin(), x.end());
  all.insert(all.end(), y.begin(), y.end());
  return all;
}

}  // namespace

bool can_be_variable(const std::string& name) {
  const auto functions = expression_functions();
  return is_name(name) && name != "t" && name != "pi" &&
         std::find(functions.begin(), functions.end(), name) == functions.end();
}

std::map<std::string, std::size_t> variables_of(char letter, Index seen, const std::vector<std::string>& x_names,
                                                Index constraints, const std::vector<std::string>& y_names) {
  std::map<std::string, std::size_t> all;
  for (Index i = 0; i < seen; ++i) all.emplace(letter + std::to_string(i), std::size_t(i));
  for (Index i = 0; i < constraints; ++i) all.emplace("y" + std::to_string(i), std::size_t(seen + i));
  const auto add = [&](const std::vector<std::string>& names, Index first) {
    for (std::size_t i = 0; i < names.size(); ++i)
      if (can_be_variable(names[i])) all.emplace(names[i], std::size_t(first) + i);
  };
  if (letter == 'x') add(x_names, 0);
  add(y_names, seen);
  return all;
}

StateFunctions state_functions(std::vector<Formula> formulas, Index seen) {
  auto entries = std::make_shared<std::vector<Entry>>();
  for (Formula& formula : formulas) {
    std::vector<std::size_t> variables = used(formula);
    entries->push_back({std::move(formula), std::move(variables)});
  }
  StateFunctions functions;
  functions.value = [entries](double t, In x, In y, Eigen::Ref<Vector> value) {
    const std::vector<double> all = joined(x, y);
    VariableNumbers numbers{t, all};
    std::vector<double> stack;
    for (std::size_t i = 0; i < entries->size(); ++i) value[Index(i)] = *execute((*entries)[i].formula, numbers, stack);
  };
  functions.derivative = [entries, seen](double t, In x, In y, Eigen::Ref<Matrix> by_x, Eigen::Ref<Matrix> by_y) {
    by_x.setZero();
    by_y.setZero();
    const std::vector<double> all = joined(x, y);
    std::vector<Slope> stack;
    for (std::size_t i = 0; i < entries->size(); ++i)
      for (const std::size_t k : (*entries)[i].variables) {
        Slopes slopes{t, all, k};
        const double slope = execute((*entries)[i].formula, slopes, stack)->slope;
        if (Index(k) < seen)
          by_x(Index(i), Index(k)) = slope;
        else
          by_y(Index(i), Index(k) - seen) = slope;
      }
  };
  return functions;
}

}  // namespace bromwich
