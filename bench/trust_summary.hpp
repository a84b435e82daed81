#pragma once
// What bromwich_trust says of each scene, and of all of them.

#include "core/result/result.hpp"
#include "tests/support/trust.hpp"

#include <nlohmann/json.hpp>

#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace bromwich::trust {

struct Outcome {
  std::uint32_t seed = 0;
  std::string verdict;  ///< right, missed, wrong, refused, ill-conditioned, or undecided (by the oracle)
  std::string status, reason, warning, method, family, sources, why_undecided;
  bool told = false, units = false;
  oracle::TrueError error;
  oracle::Apart moved{NAN, NAN, NAN};
  std::optional<ErrorEstimate> errors = {};
  double estimate = NAN, seconds = 0, oracle_seconds = 0;
  double estimate_x = NAN, estimate_y = NAN;  ///< of the certificate
  bool y_counts = true;                       ///< y is unique
  Index steps = 0;
  long events = 0, jumps = 0;
};

void print(const Outcome&);

/// Estimates of certificates beside true errors. An error is that of x, or of y where y is unique and that is larger.
struct OfCertificates {
  static constexpr double off = 0.05, right = 0.01;
  static constexpr double seen = 0.5;       ///< of an error: at least so much is estimated
  static constexpr double compared = 1e-5;  ///< smaller errors are those of the times to which breakpoints are moved
  long above = 0, above_unseen = 0, below = 0, below_doubted = 0;
  std::vector<double> ratios_x, ratios_y;  ///< estimate / error

  void add(const Outcome& o) {
    const double error = o.y_counts ? o.error.largest() : o.error.x;
    above += error > off;
    above_unseen += error > off && o.estimate < seen * off;
    below += error <= right;
    below_doubted += error <= right && o.estimate > off;
    if (o.error.x > compared) ratios_x.push_back(o.estimate_x / o.error.x);
    if (o.y_counts && o.error.y > compared) ratios_y.push_back(o.estimate_y / o.error.y);
  }
};
struct Summary {
  std::map<std::string, long> verdicts, told, not_told, reasons, undecided;
  std::vector<double> effectivity;
  OfCertificates certificates;
  double seconds = 0, oracle_seconds = 0;
  long right_with_warning = 0;
};

Summary summarise(const std::vector<Outcome>&, double tolerance);
void print(const Summary&, std::size_t count);
nlohmann::ordered_json as_json(const Outcome&);
/// Counts, quantiles and the shares of certificates.
nlohmann::ordered_json as_json(const Summary&);

}  // namespace bromwich::trust
