#pragma once
// Matrices that a word describes: identity, zero, tridiag.

#include "core/base/types.hpp"

#include <functional>
#include <optional>
#include <string>

namespace bromwich {

/// "identity", "zero", "tridiag"
std::vector<std::string> matrix_forms();

/// identity(n), identity(n, value), zero(n), zero(rows, columns), tridiag(n, lower, diagonal, upper); identity and zero
/// without arguments where `rows` and `columns` are known (positive). Nothing for other texts. `number` evaluates an
/// argument. Throws Error(where, ...) for wrong arguments.
std::optional<SparseMatrix> matrix_form(const std::string& text, Index rows, Index columns,
                                        const std::function<double(const std::string&)>& number,
                                        const std::string& where);

}  // namespace bromwich
