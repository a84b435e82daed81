#pragma once
// Derivatives of a solution with respect to parameters of its scene, those of a scene file or any others: the change of
// the data with each parameter (derivatives/parameter_change.hpp), and the derivative with respect to the data
// that fits the result (derivatives/result_derivative.hpp),
//
//     dy/dp = (dy/d data) (d data/dp).
//
// Where constraints with y_i = w_i = 0 leave derivatives along some changes alone (SwitchedDerivative::only_along), the
// parameters have those along which there is one. With boundary values the change of the discrete problem takes the
// place of that of the data.

#include "parameter_change.hpp"
#include "result_derivative.hpp"

#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// I, and its derivatives with respect to the parameters.
struct QuantityByParameters {
  double value = 0;
  Vector gradient;
};

/// Of each parameter. Throws Error where the result is not solved, and as neighbours_of does.
std::vector<ParameterNeighbours> neighbours_of_all(const std::vector<VariedParameter>&, const Scene&, const Result&);

class ParameterDerivative {
 public:
  /// `scene` and `result` are those with the values of all parameters. `located`: as in DerivativeChoice; `also`:
  /// more times of rows, within [0, T], where switches are located. Throws Error as ResultDerivative, neighbours_of
  /// and parameter_change do. The backend has to outlive this object.
  ParameterDerivative(const Scene& scene, const Result& result, Backend&, const std::vector<VariedParameter>&,
                      std::optional<bool> located = {}, const std::vector<double>& also = {});
  /// With the neighbours of all parameters (neighbours_of_all), and without the quantity of the scene file: no scene is
  /// made here.
  ParameterDerivative(std::vector<ParameterNeighbours>, const Scene& scene, const Result& result, Backend&,
                      const std::vector<VariedParameter>&, std::optional<bool> located = {},
                      const std::vector<double>& also = {});

  const ResultDerivative& of_data() const { return of_data_; }
  Index parameters() const { return Index(changes_.size()); }
  const std::vector<std::string>& names() const { return names_; }
  /// Of the rows of tables: the time points of the result, and `also` where switches are located.
  const Vector& times() const { return t_; }
  /// Rows at a switch: limits from the right.
  const std::vector<Index>& one_sided() const { return one_sided_; }
  /// Of one parameter, at the times of `of_data`.
  const DataChange& change(Index parameter) const { return changes_[std::size_t(parameter)].data; }
  /// The largest relative distance of the values that the data are taken at, see ParameterNeighbours::step.
  double distance() const { return distance_; }
  /// The derivative in words, for output: its form and how the data were differentiated.
  std::string in_words() const;

  /// The derivatives of y, x, w and the integral of y with respect to one parameter. x of scenes with more than 1000
  /// states is empty without `states`.
  SolutionChange jvp(Index parameter, bool states = false) const;
  /// The same for a change of all parameters at once.
  SolutionChange jvp(const Vector& change, bool states = false) const;
  /// The gradient of a linear function of them with respect to all parameters.
  Vector vjp(const SolutionChange& function) const;
  /// Of the quantity of the scene file. Throws Error if it has none.
  QuantityByParameters quantity() const;
  /// Of one that does not depend on the parameters.
  QuantityByParameters quantity(const QuantityOfInterest&) const;

 private:
  ParameterChange combined(const Vector& change) const;
  SolutionChange along(const Vector& change, bool states) const;
  Vector gradient(const SolutionChange& function) const;
  SolutionChange at_rows(SolutionChange) const;
  SolutionChange from_rows(const SolutionChange&) const;
  double product(const DataChange& gradient, const DataChange& change) const;
  QuantityByParameters with_gradient(QuantityChange) const;

  std::vector<std::string> names_;
  std::vector<ParameterNeighbours> neighbours_;
  Vector t_;
  ResultDerivative of_data_;
  std::vector<ParameterChange> changes_;
  std::vector<GalerkinChange> of_problem_;  ///< the same of the discrete problem, with boundary values
  std::vector<Index> rows_;                 ///< of t_ among the times of of_data_; empty: all
  std::vector<Index> one_sided_;
  std::shared_ptr<const QuantityOfInterest> quantity_;  ///< of the scene itself, or null
  double distance_ = 0;
};

}  // namespace bromwich
