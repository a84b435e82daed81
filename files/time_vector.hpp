#pragma once
// Expressions of t as one function with an entry for each.

#include "catalogue/catalogue.hpp"
#include "core/base/time_function.hpp"

#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace bromwich {

/// Compiled expressions, which functions share: those of scenes that differ in the values of parameters alone have one
/// program, with the parameters as variables, where it gives the bits of one of their own (files/shared_program.hpp).
/// Not for several threads at once; its programs are.
class Programs {
 public:
  class Program;
  /// Of checked texts. `used`: the parameters that are variables of it.
  std::shared_ptr<Program> of(const std::vector<std::string>& texts, const ParameterValues&,
                              std::vector<std::string>& used);

 private:
  struct Kept {
    std::vector<std::string> used;
    std::shared_ptr<Program> program;  ///< null: each function needs its own
  };
  std::map<std::string, Kept> kept_;  ///< by all texts
};

/// Entries with a text have its value, others that of `constants`. The texts were checked before. The function may be
/// called from several threads at once.
TimeFunction time_vector(Vector constants, const std::vector<std::pair<Index, std::string>>& texts,
                         const ParameterValues&, Programs&);

}  // namespace bromwich
