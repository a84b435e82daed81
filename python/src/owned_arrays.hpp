#pragma once
// Arrays that NumPy owns, made of those of Eigen without a copy of their numbers.

#include "arrays.hpp"

#include <cstdint>
#include <utility>

namespace bromwich::python {

template <class Table>
nb::object owned(Table table) {
  using Value = typename Table::Scalar;
  auto* held = new Table(std::move(table));
  const nb::capsule owner(held, [](void* p) noexcept { delete static_cast<Table*>(p); });
  const auto rows = std::size_t(held->rows()), cols = std::size_t(held->cols());
  if constexpr (Table::ColsAtCompileTime == 1) {
    return nb::cast(nb::ndarray<nb::numpy, Value>(held->data(), {rows}, owner));
  } else {
    const std::int64_t by_row = Table::IsRowMajor ? std::int64_t(cols) : 1;
    const std::int64_t by_column = Table::IsRowMajor ? 1 : std::int64_t(rows);
    return nb::cast(nb::ndarray<nb::numpy, Value>(held->data(), {rows, cols}, owner, {by_row, by_column}));
  }
}

}  // namespace bromwich::python
