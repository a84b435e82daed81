#pragma once
// Options and parameters as text: words key=value between blanks.

#include "bromwich/bromwich.h"
#include "catalogue/catalogue.hpp"
#include "core/solve/solver.hpp"

#include <memory>
#include <optional>
#include <string>

namespace bromwich::capi {

/// "R=500 C=R/2": numbers, or expressions of pi and of the parameters before. NULL: none.
ParameterValues parameters_of(const char* settings);

struct Settings {
  Options options;
  std::string backend = "auto", states = "auto";
  std::optional<int> device;
  int threads = 0;
};

/// NULL: the defaults of the scene. `circuit`: the default tolerance is one of the states alone, since y of ideal
/// switches need not be unique. Throws Error naming the option.
Settings settings_of(const char* text, const Scene&, bool circuit);

/// As `backend`, `device` and `threads` say; auto: a CUDA device where it is predicted to be faster.
std::shared_ptr<Backend> backend_of(const Settings&, const Scene&);

/// The functions of a caller, of the version that its `size` says. NULL: none.
bromwich_hooks hooks_of(const bromwich_hooks*);
/// Has the solve call them.
void listen(Options&, const bromwich_hooks&);

}  // namespace bromwich::capi
