#pragma once
// Least squares: parameters of a scene from measured values of y, w and x, or of a netlist from those of its outputs.
//
// Minimises Σ_k (c_k(p) - d_k)² over the parameters p, c_k the column of the solution at the time of datum k, by
// Levenberg and Marquardt's method (MINPACK, as Eigen has it). Bounds by the substitutions of MINUIT (James & Roos,
// Comput. Phys. Commun. 10, 1975): p = a + (b - a)(1 + sin u)/2, or p = a - 1 + sqrt(u² + 1) with one bound.
//
// The Jacobian is a derivative with respect to parameters (derivatives/parameter_derivative.hpp), or by central
// differences of solves where that is refused.

#include "app/columns.hpp"
#include "catalogue/catalogue.hpp"
#include "circuits/circuit.hpp"
#include "core/solve/solve.hpp"

#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

namespace bromwich::app {

struct FreeParameter {
  std::string name;
  double start = 0;
  double low = -std::numeric_limits<double>::infinity(), high = std::numeric_limits<double>::infinity();
};

/// Measured values; NaN: none at this time.
struct FitData {
  std::vector<double> t;
  std::vector<Column> columns;
  RowMatrix values;  ///< times x columns
};

/// What is fitted, for values of its parameters. Columns of a circuit are the names of probes.
struct FitModel {
  FitModel(Scene s, std::shared_ptr<const Circuit> of = {}) : scene(std::move(s)), circuit(std::move(of)) {}

  Scene scene;
  std::shared_ptr<const Circuit> circuit;  ///< or null
};
using FitModels = std::function<FitModel(const Vector&)>;

/// A CSV file with the header t,NAME,... and rows of numbers; an empty field or nan is no datum. Names as in the output
/// of solve. Throws Error(argument, ...) that names the line.
FitData read_fit_data(const std::string& argument, const std::string& file, const FitModel&);

/// Of a result with all states and N x.
double value_of(const Scene&, const Result&, Index j, const Column&);
/// The same of all rows: rows x columns.
RowMatrix values_of(const FitModel&, const Result&, const std::vector<Column>&);

struct Fit {
  Vector p, deviation;           ///< parameters and standard deviations; NaN where the data do not determine them
  Matrix correlation;            ///< of the parameters
  Vector low, high;              ///< 95 % intervals, by Student's t
  double deviation_of_data = 0;  ///< sqrt(Σ r² / (data - parameters))
  Index data = 0, evaluations = 0, jacobians = 0;
  bool converged = false;
  std::string ended;        ///< how the iteration ended, in words
  std::string derivatives;  ///< how the Jacobian was made, in words
};

/// `model_of`: what values of the parameters make. Throws Error where the start cannot be solved.
Fit fit(const FitModels& model_of, const std::vector<FreeParameter>&, const FitData&, Backend&, const Options&);

}  // namespace bromwich::app
