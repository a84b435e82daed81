#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "report/result_table.hpp"

#include <gtest/gtest.h>

#include <unistd.h>
#include <filesystem>
#include <fstream>

namespace bromwich::report {
namespace {

class ResultFile : public testing::Test {
 protected:
  ResultTable of(const std::string& text, const std::string& name = "r.csv") {
    path_ = folder_ / name;
    std::ofstream(path_) << text;
    return read_result("RESULT", path_);
  }
  void SetUp() override { std::filesystem::create_directory(folder_); }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  // Tests run side by side, each in a process of its own.
  std::filesystem::path folder_ =
      std::filesystem::temp_directory_path() / ("bromwich_table_" + std::to_string(::getpid()));
  std::filesystem::path path_;
};

TEST_F(ResultFile, HasItsColumnsByKind) {
  const ResultTable table =
      of("t [s],y0,y1,x3 [A],energy\n"
         "0,1,nan,3,4\r\n"
         "0.5,1e-3,2,3.5,5\n"
         "# ended at t = 0.5: infeasible, no solution\n");
  ASSERT_EQ(table.quantities.size(), 3u);
  EXPECT_EQ(table.time_unit, "s");
  EXPECT_EQ(table.t, (Vector(2) << 0, 0.5).finished());
  const Quantity &y = *table.find("y"), &x = *table.find("x"), &other = *table.find("");
  EXPECT_EQ(y.names, (std::vector<std::string>{"y0", "y1"}));
  EXPECT_TRUE(std::isnan(y.values(0, 1)));
  EXPECT_EQ(y.values(1, 0), 1e-3);
  EXPECT_EQ(x.names.front(), "x3");
  EXPECT_EQ(x.units.front(), "A");
  EXPECT_EQ(x.values(1, 0), 3.5);
  EXPECT_EQ(other.names.front(), "energy");
  EXPECT_EQ(table.find("w"), nullptr);
  EXPECT_EQ(table.remark, "ended at t = 0.5: infeasible, no solution");
}

TEST_F(ResultFile, IsRefusedInOneLine) {
  const auto message = [&](const std::string& text, const std::string& name = "r.csv") -> std::string {
    try {
      of(text, name);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  const auto has = [](const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
  };
  EXPECT_TRUE(has(message(""), "r.csv:1: found no header"));
  EXPECT_TRUE(has(message("time,y0\n0,1\n"), "r.csv:1: found no header"));
  EXPECT_TRUE(has(message("t,y0\n0,1\n1\n"), "r.csv:3: found 1 values where the header has 2"));
  EXPECT_TRUE(has(message("t,y0\n0,one\n"), "r.csv:2: 'one'"));
  EXPECT_TRUE(has(message("t,y0\n1,1\n0,1\n"), "r.csv:3: the times do not ascend"));
  EXPECT_TRUE(has(message("t,y0\nnan,1\n"), "r.csv:2: the times do not ascend"));
  EXPECT_TRUE(has(message("t,y0\n0,1\n", "r.xlsx"), "give a file .csv"));
  EXPECT_THROW(read_result("RESULT", "/none/r.csv"), Error);
}

// w of the table is what complementarity needs: y and w are not negative, and one of the two is 0.
TEST(ResultTable, HasWOfASolve) {
  const Scene scene = make_scene("signorini", {{"Q", 7}});
  const auto backend = make_cpu_backend(1);
  Options options;
  options.steps = 40;
  options.trace = true;
  const Result result = solve(scene, *backend, options);
  const ResultTable table = as_table(scene, result);
  const Quantity &y = *table.find("y"), &w = *table.find("w");
  EXPECT_EQ(y.values, result.y);
  // Rounding of one row: terms below 10, times 2e-16 and some tens of operations.
  EXPECT_LE(y.values.cwiseMin(w.values).cwiseAbs().maxCoeff(), 1e-13);
  EXPECT_GT(w.values.maxCoeff(), 0.01);
  EXPECT_EQ(table.find("x"), nullptr);
}

}  // namespace
}  // namespace bromwich::report
