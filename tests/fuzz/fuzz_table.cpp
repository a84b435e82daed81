// Tables of numbers between commas, with and without times.

#include "files/number_files.hpp"
#include "tests/fuzz/read.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace bromwich;
  const std::string text(fuzz::text(data, size));
  fuzz::accepts([&] { read_number_table(text, "fuzz.csv"); });
  return fuzz::accepts([&] {
    TimeTable table = read_time_table(text, "fuzz.csv", 'f');
    kinks(table, 1);
    Vector values(table.values.cols());
    const TimeFunction function = interpolate(std::move(table));
    for (const double t : {-1.0, 0.0, 0.4, 1e9}) function(t, values);
  });
}
