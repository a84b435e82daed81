// `bromwich solve` with [sweep]: tables of many scenes, against the command with the same parameters.

#include "tests/app/cli.hpp"

#include <nlohmann/json.hpp>

#include <cmath>

namespace bromwich {
namespace {

class CliSweep : public Cli {
 protected:
  void write(const std::string& name, const std::string& text) const { std::ofstream(folder_ / name) << text; }
  fs::path path(const std::string& name) const { return folder_ / name; }
};

const std::string swept = R"toml(
name = "swept"
[parameters]
R = 1
a = 1
[dynamics]
A = [[-1]]
B = [[1]]
f = ["a*sin(3*t)"]
x0 = ["1/a"]
[complementarity]
N = [[1]]
M = [["R"]]
[time]
T = 2
steps = 50
[output]
states = "all"
[sweep]
R = [1, 4]
a = [0.5, 0, 2]
)toml";

TEST_F(CliSweep, OneRowPerSceneWithAStatusEach) {
  write("s.toml", swept);
  const Outcome found = run("solve s.toml --out t.csv");
  EXPECT_EQ(found.exit_code, 3) << found.err;  // a = 0 has no x0
  const std::vector<std::string> lines = split(read(path("t.csv")), '\n');
  ASSERT_EQ(lines.size(), 7u);
  EXPECT_EQ(lines[0], "scene,R,a,status,residual,y0(T),max|y0|,x0(T),max|x0|,reason,warning");
  for (const std::size_t k : {0, 2, 3, 5}) {
    const std::vector<std::string> words = split(lines[k + 1], ',');
    EXPECT_EQ(words.at(0), std::to_string(k));
    EXPECT_EQ(words.at(3), "solved");
    write("one.toml", swept.substr(0, swept.find("[sweep]")));
    const std::string set = " --set R=" + words.at(1) + " a=" + words.at(2);
    ASSERT_EQ(run("solve one.toml --method march --out one.csv" + set).exit_code, 0);
    const std::vector<std::string> rows = split(read(path("one.csv")), '\n'), last = split(rows.back(), ',');
    EXPECT_NEAR(std::stod(words.at(5)), std::stod(last.at(1)), 1e-12);
    EXPECT_NEAR(std::stod(words.at(7)), std::stod(last.at(2)), 1e-12);
  }
  for (const std::size_t k : {1, 4})
    EXPECT_NE(lines[k + 1].find(",0,unsupported,nan,nan,nan,nan,nan,\""), std::string::npos);
  EXPECT_NE(found.out.find("status      4 solved, 2 unsupported"), std::string::npos) << found.out;
}

// Against the command with the same parameters, tolerance, times and columns.
TEST_F(CliSweep, RowsAtTimesWithATolerance) {
  write("s.toml", swept);
  write("one.toml", swept.substr(0, swept.find("[sweep]")));
  for (const std::string options : {"", "--tol 1e-4 "}) {
    ASSERT_EQ(run("solve s.toml --columns x0,w0 --at 0.31,2 --out t.csv " + options).exit_code, 3);
    const std::vector<std::string> lines = split(read(path("t.csv")), '\n');
    ASSERT_EQ(lines.size(), 13u);
    EXPECT_EQ(lines[0], "scene,R,a,t,status,residual,x0,w0,reason,warning");
    for (const std::size_t k : {1, 2, 5, 6}) {
      const std::vector<std::string> words = split(lines[k], ',');
      const std::string set = " --set R=" + words.at(1) + " a=" + words.at(2);
      ASSERT_EQ(run("solve one.toml --columns x0,w0 --out one.csv " + options + "--at " + words.at(3) + set).exit_code,
                0);
      const std::vector<std::string> row = split(split(read(path("one.csv")), '\n').at(1), ',');
      EXPECT_EQ(words.at(4), "solved");
      EXPECT_NEAR(std::stod(words.at(6)), std::stod(row.at(1)), 1e-12);
      EXPECT_NEAR(std::stod(words.at(7)), std::stod(row.at(2)), 1e-12);
    }
  }
  const Outcome found = run("solve s.toml --tol 1e-4 --out t.csv");
  EXPECT_EQ(split(read(path("t.csv")), '\n').size(), 7u) << found.err;
}

// x = a e^{-t}: between rows h apart a line errs by h^2 / 8 of it at most.
TEST_F(CliSweep, MeasuresOfASpan) {
  write("s.toml",
        "[parameters]\na = 1\nk = 4\n[dynamics]\nA = [[-1]]\nx0 = [\"a\"]\n[time]\nT = 2\nsteps = 200\n"
        "[names]\nx = [\"v\"]\n[sweep]\na = [1, -3]\n");
  const std::string columns = "--columns 'v,mean(v),rms(v),min(v),max(v),ripple(v, T/k, T)'";
  const Outcome found = run("solve s.toml --out t.csv " + columns);
  ASSERT_EQ(found.exit_code, 0) << found.err;
  const std::vector<std::string> lines = split(read(path("t.csv")), '\n');
  EXPECT_EQ(lines[0],
            "scene,a,status,residual,v(T),max|v|,mean(v),rms(v),min(v),max(v),\"ripple(v,T/k,T)\",reason,warning");
  const double T = 2, h2 = 1e-4 / 8;
  for (const std::size_t k : {0, 1}) {
    const std::vector<std::string> words = split(lines[k + 1], ',');
    const double a = k == 0 ? 1 : -3, e = std::exp(-T);
    const std::vector<double> expected{a * (1 - e) / T, 3 * std::sqrt((1 - e * e) / (2 * T)) / (k == 0 ? 3 : 1),
                                       std::min(a, a * e), std::max(a, a * e), std::abs(a) * (std::exp(-T / 4) - e)};
    for (std::size_t i = 0; i < expected.size(); ++i)
      EXPECT_NEAR(std::stod(words.at(6 + i)), expected[i], 3 * h2 + 1e-12) << lines[k + 1] << ", " << i;
  }
  const auto why = [&](const std::string& given, const std::string& options = "") {
    return refused("solve s.toml --out t.csv --columns '" + given + "' " + options).err;
  };
  EXPECT_TRUE(contains(why("maen(v)"), "'maen(v)' (did you mean 'mean'?)"));
  EXPECT_TRUE(contains(why("mean(u)"), "found 'u'"));
  EXPECT_TRUE(contains(why("mean(v, 1, 3)"), "the span 1 to 3; give ascending times from 0 to T = 2"));
  EXPECT_TRUE(contains(why("mean(v, 1)"), "no times or two"));
  EXPECT_TRUE(contains(why("mean(v)", "--at 1"), "asks for mean(v) with --at"));
}

TEST_F(CliSweep, PlotDrawsMapsAndCurves) {
  write("s.toml", swept);
  run("solve s.toml --out t.csv");
  ASSERT_EQ(run("plot t.csv").exit_code, 0);
  const std::string page = read(path("t.html"));
  EXPECT_TRUE(contains(page, "4 of 6 scenes solved, over R, a."));
  for (const char* column : {"y0(T)", "max|y0|", "x0(T)", "max|x0|"})
    EXPECT_TRUE(contains(page, std::string(column) + " over a and R")) << column;
  EXPECT_FALSE(contains(page, "residual over"));
  write("one.toml", swept.substr(0, swept.find("a = [0.5")));  // R alone
  ASSERT_EQ(run("solve one.toml --out one.csv").exit_code, 0);
  ASSERT_EQ(run("plot one.csv --out r.html").exit_code, 0);
  EXPECT_TRUE(contains(read(path("r.html")), "x0(T) over R"));
}

// The page of the arrays of all scenes is that of the table of the same scenes, whose numbers have all digits.
TEST_F(CliSweep, PlotOfHdf5IsThatOfTheTable) {
  std::string regular = swept;
  regular.replace(regular.find("0.5, 0, 2"), 9, "0.5, 1, 2");
  write("s.toml", regular);
  ASSERT_EQ(run("solve s.toml --out s.csv").exit_code, 0);
  const Outcome arrays = run("solve s.toml --out s.h5");
  if (contains(arrays.err, "needs HDF5")) GTEST_SKIP() << "this build has no HDF5";
  ASSERT_EQ(arrays.exit_code, 0) << arrays.err;
  ASSERT_EQ(run("plot s.csv --out csv.html").exit_code, 0);
  ASSERT_EQ(run("plot s.h5 --out h5.html").exit_code, 0);
  const auto pictures = [&](const std::string& name) {
    const std::string page = read(path(name));
    return page.substr(page.find("<figure"), page.find("<footer") - page.find("<figure"));
  };
  EXPECT_EQ(pictures("csv.html"), pictures("h5.html"));
  EXPECT_NE(read(path("h5.html")).find("6 of 6 scenes solved, over R, a."), std::string::npos);
}

// The file may name the columns of its table; --columns replaces them, and files of all time points have no use for
// them.
TEST_F(CliSweep, ColumnsOfTheFile) {
  write("s.toml", swept + "columns = [\"x0\", \"mean(x0)\", \"ripple(x0, T/2, T)\"]\n");
  ASSERT_EQ(run("solve s.toml --out s.csv").exit_code, 3);
  ASSERT_EQ(run("solve s.toml --columns 'x0,mean(x0),ripple(x0, T/2, T)' --out other.csv").exit_code, 3);
  EXPECT_EQ(read(path("s.csv")), read(path("other.csv")));
  ASSERT_EQ(run("solve s.toml --columns y0 --out s.csv").exit_code, 3);
  EXPECT_EQ(split(read(path("s.csv")), '\n').at(0), "scene,R,a,status,residual,y0(T),max|y0|,reason,warning");
  EXPECT_EQ(run("solve s.toml --at 1 --out s.csv").exit_code, 3);
  write("s.toml", swept + "columns = \"x0,mean(z)\"\n");
  const Outcome refused = run("solve s.toml --out s.csv");
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_NE(refused.err.find("s.toml:22: sweep.columns: "), std::string::npos) << refused.err;
}

TEST_F(CliSweep, JsonCountsScenesAndSeconds) {
  write("s.toml", swept);
  const auto json = nlohmann::json::parse(run("solve s.toml --json").out);
  EXPECT_EQ(json["scenes"], 6);
  EXPECT_EQ(json["status"]["solved"], 4);
  for (const char* part : {"read", "solve"}) {
    EXPECT_GT(json["seconds"][part], 0) << part;
    EXPECT_LE(json["seconds"][part], json["seconds"]["total"]) << part;
  }
}

// Matrices, sources and tables of scenes before, and x0 of each: a swept parameter leaves nothing of another scene.
TEST_F(CliSweep, ScenesInAnyOrderAreTheSame) {
  const std::string head = swept.substr(0, swept.find("R = [1, 4]"));
  write("s.toml", head + "R = [1, 4, 1, 2]\na = [0.5, 2, 2, 0.5]\nT = [2, 2, 3, 2]\ncombine = \"rows\"\n");
  write("other.toml", head + "R = [2, 1, 4, 1]\na = [0.5, 2, 2, 0.5]\nT = [2, 3, 2, 2]\ncombine = \"rows\"\n");
  ASSERT_EQ(run("solve s.toml --out t.csv --method march").exit_code, 0);
  ASSERT_EQ(run("solve other.toml --out other.csv --method march").exit_code, 0);
  const auto rows = split(read(path("t.csv")), '\n'), others = split(read(path("other.csv")), '\n');
  const auto values = [](const std::string& row) { return row.substr(row.find(',')); };
  for (std::size_t k = 1; k <= 4; ++k) EXPECT_EQ(values(rows.at(k)), values(others.at(5 - k)));
}

TEST_F(CliSweep, WhatDoesNotGoWithASweepIsRefused) {
  write("s.toml", swept);
  for (const auto& [words, message] : {std::pair("--columns trace0 --out t.csv", "--columns: asks for trace0"),
                                       {"--set R=3", "--set: 'R' is swept"},
                                       {"--out t.npz", "--out: 't.npz' does not end in .csv or .h5"},
                                       {"--at 0.5", "--at: found '0.5' without --out"},
                                       {"--switches t.csv", "--switches: is given for a scene with"}}) {
    const Outcome found = run(std::string("solve s.toml ") + words);
    EXPECT_EQ(found.exit_code, 2) << words;
    EXPECT_NE(found.err.find(message), std::string::npos) << found.err;
  }
}

}  // namespace
}  // namespace bromwich
