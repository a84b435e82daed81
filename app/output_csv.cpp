#include "app/output_csv.hpp"

#include "app/text.hpp"

#include <fmt/format.h>

#include <cmath>
#include <iterator>

namespace bromwich::app {

namespace {

constexpr std::size_t flush_bytes = 1 << 20;

void append(fmt::memory_buffer& text, double value) {
  // A NaN may carry a sign, which readers of the file do not expect.
  if (std::isnan(value))
    fmt::format_to(std::back_inserter(text), ",nan");
  else
    fmt::format_to(std::back_inserter(text), ",{}", value);
}

/// `count` values of row j; nan for values that the array does not have.
void append_row(fmt::memory_buffer& text, const RowMatrix& values, Index j, Index count) {
  for (Index i = 0; i < count; ++i) append(text, j < values.rows() && i < values.cols() ? values(j, i) : std::nan(""));
}

bool any_finite(const RowMatrix& values, Index j) {
  return j < values.rows() && values.row(j).array().isFinite().any();
}

/// Whether a row has a value; only such rows are written for a result that is not solved.
bool valid(const Result& result, Index j) { return any_finite(result.y, j) || any_finite(result.x, j); }

/// The comment after the rows of a result that is not solved.
void append_end(fmt::memory_buffer& text, const Result& result) {
  if (result.status == Status::solved) return;
  Index last = result.t.size() - 1;
  while (last >= 0 && !valid(result, last)) --last;
  const std::string when = last < 0 ? "before t = 0" : fmt::format("at t = {}", result.t[last]);
  fmt::format_to(std::back_inserter(text), "# ended {}: {}, {}\n", when, to_string(result.status),
                 result.reason.empty() ? "no reason was given" : one_line(result.reason));
}

void flush(fmt::memory_buffer& text, std::FILE* file) {
  std::fwrite(text.data(), 1, text.size(), file);
  text.clear();
}

}  // namespace

void write_csv(const Result& result, Index constraints, std::FILE* file, const Energies* energies) {
  write_csv(result, result, constraints, file, energies);
}

void write_csv(const Result& sampled, const Result& result, Index constraints, std::FILE* file,
               const Energies* energies) {
  fmt::memory_buffer text;
  const auto out = std::back_inserter(text);
  fmt::format_to(out, "t");
  for (Index i = 0; i < constraints; ++i) fmt::format_to(out, ",y{}", i);
  for (const Index component : sampled.x_components) fmt::format_to(out, ",x{}", component);
  if (energies) fmt::format_to(out, ",energy,supplied_power,dissipated_power,supplied,dissipated,violation");
  fmt::format_to(out, "\n");
  for (Index j = 0; j < sampled.t.size(); ++j) {
    if (result.status != Status::solved && !valid(sampled, j)) continue;
    fmt::format_to(out, "{}", sampled.t[j]);
    append_row(text, sampled.y, j, constraints);
    append_row(text, sampled.x, j, Index(sampled.x_components.size()));
    if (energies) {
      const EnergyBalance& steps = energies->balance;
      for (const Vector* part : {&steps.energy, &energies->power.supplied, &energies->power.dissipated})
        append(text, (*part)[j]);
      for (const Vector* part : {&steps.supplied, &steps.dissipated, &steps.violation})
        append(text, j > 0 ? (*part)[j - 1] : 0);
    }
    fmt::format_to(out, "\n");
    if (text.size() > flush_bytes) flush(text, file);
  }
  append_end(text, result);
  flush(text, file);
}

void write_switches_csv(const std::vector<Switch>& switches, const Result& result, std::FILE* file) {
  fmt::memory_buffer text;
  const auto out = std::back_inserter(text);
  fmt::format_to(out, "t,component,on,error\n");
  for (const Switch& s : switches) fmt::format_to(out, "{},{},{},{}\n", s.t, s.component, s.on ? 1 : 0, s.error);
  append_end(text, result);
  flush(text, file);
}

}  // namespace bromwich::app
