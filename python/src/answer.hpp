#pragma once
// A result as Python holds it: with what is needed to look between its time points.

#include "core/result/result.hpp"
#include "machine.hpp"
#include "module.hpp"

#include <optional>

namespace bromwich::python {

struct Answer {
  std::shared_ptr<const Model> model;
  std::shared_ptr<Machine> machine;
  Options options;  ///< without the callbacks
  Result result;
  bool by_keyboard = false;        ///< Ctrl-C ended the solve
  std::optional<RowMatrix> slack;  ///< w, once it was asked for
};

}  // namespace bromwich::python
