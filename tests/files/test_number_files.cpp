// Matrices and tables in files beside a scene: every variant of Matrix Market against the dense matrix, and mistakes
// reported with the line of their own file.

#include "core/base/error.hpp"
#include "core/dynamics/dynamics.hpp"
#include "files/number_files.hpp"
#include "files/scene_file.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>

#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace bromwich {
namespace {

namespace fs = std::filesystem;

Matrix market(const std::string& text) {
  return std::visit([](const auto& matrix) { return Matrix(matrix); }, read_matrix_market(text, "A.mtx"));
}

TEST(MatrixMarket, ReadsEveryVariant) {
  const std::string head = "%%MatrixMarket matrix ";
  EXPECT_EQ(market(head + "coordinate real general\n% comment\n\n2 3 3\n1 1 1.5\n2 3 -2e1\n1 2 +4\n"),
            (Matrix{{1.5, 4, 0}, {0, 0, -20}}));
  EXPECT_EQ(market(head + "coordinate integer symmetric\n2 2 2\n1 1 3\n2 1 -1"), (Matrix{{3, -1}, {-1, 0}}));
  EXPECT_EQ(market(head + "coordinate real skew-symmetric\n2 2 1\n2 1 5\n"), (Matrix{{0, -5}, {5, 0}}));
  EXPECT_EQ(market(head + "coordinate pattern general\n2 2 2\n1 2\n2 1\n"), (Matrix{{0, 1}, {1, 0}}));
  EXPECT_EQ(market(head + "coordinate pattern symmetric\n2 2 1\n2 1\n"), (Matrix{{0, 1}, {1, 0}}));
  EXPECT_EQ(market(head + "coordinate real general\n1 1 2\n1 1 2\n1 1 3\n"), (Matrix{{5}}));
  EXPECT_EQ(market(head + "coordinate real general\n2 1 0\n"), (Matrix{{0}, {0}}));
  EXPECT_EQ(market(head + "array real general\n2 2\n1\n2\n3\n4\n"), (Matrix{{1, 3}, {2, 4}}));
  EXPECT_EQ(market(head + "array integer symmetric\n2 2\n1\n2\n3\n"), (Matrix{{1, 2}, {2, 3}}));
  EXPECT_EQ(market(head + "array real skew-symmetric\n3 3\n1\n2\n3\n"), (Matrix{{0, -1, -2}, {1, 0, -3}, {2, 3, 0}}));
  EXPECT_EQ(market("%%MatrixMarket MATRIX Coordinate Real GENERAL\r\n1 1 1\r\n1 1 7\r\n"), (Matrix{{7}}));
}

TEST(MatrixMarket, MistakesNameTheirLine) {
  const std::string coordinate = "%%MatrixMarket matrix coordinate real general\n";
  const std::string symmetric = "%%MatrixMarket matrix coordinate real symmetric\n";
  const std::string skew = "%%MatrixMarket matrix coordinate real skew-symmetric\n";
  const std::string array = "%%MatrixMarket matrix array real general\n";
  const std::vector<Refused> cases{
      {"", "A.mtx:1: the first line is no Matrix Market header"},
      {"1 2 3\n", "A.mtx:1: the first line is no Matrix Market header"},
      {"%%MatrixMarket vector coordinate real general\n", "A.mtx:1: the object is 'vector'"},
      {"%%MatrixMarket matrix dense real general\n", "A.mtx:1: the format is 'dense'"},
      {"%%MatrixMarket matrix coordinate complex general\n", "A.mtx:1: the field is 'complex'"},
      {"%%MatrixMarket matrix coordinate real hermitian\n", "A.mtx:1: the symmetry is 'hermitian'"},
      {"%%MatrixMarket matrix array pattern general\n", "A.mtx:1: an array cannot be a pattern"},
      {"%%MatrixMarket matrix coordinate pattern skew-symmetric\n", "A.mtx:1: a pattern cannot be skew-symmetric"},
      {coordinate, "A.mtx:1: the file ends before its sizes"},
      {coordinate + "2 2\n", "A.mtx:2: found 2 sizes; give 3 whole numbers"},
      {coordinate + "0 2 1\n", "A.mtx:2: the number of rows is '0'"},
      {coordinate + "2 999999999999 1\n", "A.mtx:2: the number of columns is '999999999999'"},
      {coordinate + "2 2 x\n", "A.mtx:2: the number of entries is 'x'"},
      {coordinate + "2 2 2\n1 1 1\n", "A.mtx:3: the file ends after 1 of 2 entries"},
      {coordinate + "2 2 1\n1 1 1\n\n% end\n2 2 2\n", "A.mtx:6: found more than the 1 entries announced"},
      {coordinate + "2 2 1\n1 1\n", "A.mtx:3: found 2 words; write row, column and value"},
      {coordinate + "2 2 1\n3 1 1\n", "A.mtx:3: the row is '3'; write a whole number from 1 to 2"},
      {coordinate + "2 2 1\n1 0 1\n", "A.mtx:3: the column is '0'"},
      {coordinate + "2 2 1\n% here\n1 1 one\n", "A.mtx:4: 'one' is no finite number"},
      {coordinate + "2 2 1\n1 1 nan\n", "A.mtx:3: 'nan' is no finite number"},
      {symmetric + "2 3 1\n1 1 1\n", "A.mtx:2: the matrix is 2 x 3; make a symmetric matrix square"},
      {symmetric + "2 2 1\n1 2 1\n", "A.mtx:3: entry (1, 2) is not below the diagonal"},
      {skew + "2 2 1\n1 1 1\n", "A.mtx:3: entry (1, 1) is not below the diagonal"},
      {array + "2 2\n1\n2\n3\n", "A.mtx:5: the file ends after 3 of 4 entries"},
      {array + "1 1\n1\n2\n", "A.mtx:4: found more than the 1 entries announced"},
      {array + "1 2\n1 2\n", "A.mtx:3: found 2 words; write one number per line"},
      {array + "10000000 10000000\n1\n", "A.mtx:2: the sizes announce 100000000000000 entries"},
      {coordinate + "10000001 2 1\n", "A.mtx:2: the number of rows is '10000001'"},
  };
  for (const Refused& bad : cases) {
    const std::string found = refusal([&] { read_matrix_market(bad.text, "A.mtx"); });
    EXPECT_TRUE(found.starts_with(bad.message)) << found << "\nexpected: " << bad.message;
  }
}

TEST(NumberTable, ReadsRowsAndSkipsComments) {
  EXPECT_EQ(read_number_table("# head\n1, 2.5\n\n-3e2,4\n", "A.csv"), (Matrix{{1, 2.5}, {-300, 4}}));
  EXPECT_EQ(read_number_table("7", "A.csv"), (Matrix{{7}}));
}

TEST(NumberTable, MistakesNameTheirLine) {
  const std::vector<Refused> cases{
      {"", "A.csv:1: the file holds no numbers"},
      {"1,2\n3\n", "A.csv:2: found 1 values where the lines before have 2"},
      {"1,2\n3,x\n", "A.csv:2: 'x' is no finite number"},
      {"1,,2\n", "A.csv:1: '' is no finite number"},
      {"1;2\n", "A.csv:1: '1;2' is no finite number"},
  };
  for (const Refused& bad : cases) {
    const std::string found = refusal([&] { read_number_table(bad.text, "A.csv"); });
    EXPECT_TRUE(found.starts_with(bad.message)) << found << "\nexpected: " << bad.message;
  }
}

TimeTable table_until(double last_time, const std::string& text) {
  TimeTable table = read_time_table(text, "f.csv", 'f');
  require_times_until(table, last_time);
  return table;
}

TEST(TimeTable, JumpsWhereATimeIsGivenTwice) {
  const TimeTable table = table_until(2, "t,f0\n0,1\n1,3\n1,-2\n2,0\n");
  const TimeFunction f = interpolate(table);
  Vector value(1);
  for (const auto& [t, expected] : std::vector<std::pair<double, double>>{{0.5, 2}, {1, -2}, {1.5, -1}, {2, 0}}) {
    f(t, value);
    EXPECT_DOUBLE_EQ(value[0], expected) << t;
  }
  f(std::nextafter(1., 0.), value);
  EXPECT_NEAR(value[0], 3, 1e-15);
  EXPECT_EQ(kinks(table, 2), (std::vector<double>{1}));
}

TEST(TimeTable, KinksAreKnotsWhereTheSlopeChanges) {
  const std::string text =
      "t,f0,f1\n-1,0,0\n0.25,1.25,0\n0.5,1.5,0\n0.75,1.75,1\n1,1.75,2\n1.5,1.75,4\n2,1.75,4\n3,0,4\n";
  const TimeTable table = table_until(1.75, text);
  EXPECT_EQ(kinks(table, 1.75), (std::vector<double>{0.5, 0.75, 1.5}));
  EXPECT_EQ(kinks(table, 4), (std::vector<double>{0.5, 0.75, 1.5, 2, 3}));  // constant after the last row
}

TEST(TimeTable, IsLinearBetweenItsTimes) {
  const TimeFunction f = interpolate(table_until(2, "t,f0,f1\n0,1,10\n0.5,3,10\n2,0,-20\n"));
  const auto at = [&](double t) {
    Vector value(2);
    f(t, value);
    return value;
  };
  EXPECT_EQ(at(0), (Vector{{1, 10}}));
  EXPECT_EQ(at(0.25), (Vector{{2, 10}}));
  EXPECT_EQ(at(0.5), (Vector{{3, 10}}));
  EXPECT_EQ(at(1.25), (Vector{{1.5, -5}}));  // halves are exact
  EXPECT_EQ(at(2), (Vector{{0, -20}}));
  EXPECT_EQ(at(3), (Vector{{0, -20}}));
}

TEST(TimeTable, LastTimeMayBeRounded) {
  EXPECT_EQ(table_until(9.42477796076938, "t,f0\n-1,0\n9.42477796077,0\n").t.size(), 2);
  EXPECT_EQ(table_until(9.42477796076938, "t,f0\n0,0\n9.424777960,0\n").t.size(), 2);
}

TEST(TimeTable, MistakesNameTheirLine) {
  const std::vector<Refused> cases{
      {"", "f.csv:1: found no header; begin with a line t,f0,f1,..."},
      {"0,1\n2,1\n", "f.csv:1: found no header"},
      {"t\n0\n", "f.csv:1: found no header"},
      {"t,f1\n0,1\n", "f.csv:1: column 1 is 'f1', not f0"},
      {"t,g0\n0,1\n", "f.csv:1: column 1 is 'g0', not f0"},
      {"t,f0\n", "f.csv:1: the file holds no times"},
      {"t,f0\n0,1\n1\n", "f.csv:3: found 1 values where the lines before have 2"},
      {"t,f0\n0.5,1\n2,1\n", "f.csv:2: the times begin at 0.5"},
      {"t,f0\n0,1\n1,1\n0.5,2\n2,2\n", "f.csv:4: the time 0.5 follows 1; give ascending times"},
      {"t,f0\n0,1\n1,1\n1,2\n1,3\n2,2\n", "f.csv:5: the time 1 is given three times; give the values before and"},
      {"t,f0\n0,1\n1.5,1\n", "f.csv:3: the times end at 1.5, before T = 2"},
      {"t,f0\n0,1\n2,inf\n", "f.csv:3: 'inf' is no finite number"},
  };
  for (const Refused& bad : cases) {
    const std::string found = refusal([&] { table_until(2, bad.text); });
    EXPECT_TRUE(found.starts_with(bad.message)) << found << "\nexpected: " << bad.message;
  }
}

/// A separate folder per test, removed at the end.
class SceneFolder : public testing::Test {
 protected:
  void SetUp() override {
    const std::string name = testing::UnitTest::GetInstance()->current_test_info()->name();
    folder_ = fs::temp_directory_path() / ("bromwich_scene_" + name + "_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  void write(const std::string& name, const std::string& text) const { std::ofstream(folder_ / name) << text; }
  SceneFile read(const std::string& text) const {
    write("my.toml", text);
    return read_scene_file(folder_ / "my.toml");
  }
  std::string refused(const std::string& text) const {
    return refusal([&] { read(text); });
  }
  /// Messages name files by their path.
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  fs::path folder_;
};

std::string scene(const std::string& A, const std::string& B, const std::string& x0, const std::string& N,
                  const std::string& M, const std::string& more = "") {
  return "[dynamics]\nA = " + A + "\nB = " + B + "\nx0 = " + x0 + "\n" + more + "[complementarity]\nN = " + N +
         "\nM = " + M + "\n[time]\nT = 2\n";
}

TEST_F(SceneFolder, MatricesVectorsAndSourcesComeFromFiles) {
  fs::create_directory(folder_ / "data");
  write("data/A.mtx", "%%MatrixMarket matrix coordinate real general\n2 2 2\n1 1 -1\n2 1 3\n");
  write("B.csv", "1\n2\n");
  write("x0.csv", "5,6\n");
  write("N.mtx", "%%MatrixMarket matrix array real general\n1 2\n1\n0\n");
  write("f.csv", "t,f0,f1\n0,0,0\n2,2,4\n");
  const SceneFile file =
      read(scene("\"data/A.mtx\"", "\"B.csv\"", "\"x0.csv\"", "\"N.mtx\"", "[[1]]", "f = \"f.csv\"\n"));
  const auto& dense = get<DenseDynamics>(file.scene.dynamics);
  EXPECT_EQ(dense.A, (Matrix{{-1, 0}, {3, 0}}));
  EXPECT_EQ(dense.B, (Matrix{{1}, {2}}));
  EXPECT_EQ(dense.N, (Matrix{{1, 0}}));
  EXPECT_EQ(file.scene.x0, (Vector{{5, 6}}));
  Vector f(2);
  file.scene.f(1, f);
  EXPECT_EQ(f, (Vector{{1, 2}}));
}

// A tent of height 1 at t = 1 as the second entry, beside an expression and a number.
TEST_F(SceneFolder, AListOfFunctionsMayNameTables) {
  write("u.csv", "t,f0\n0,0\n1,1\n2,0\n");
  const std::string three = "f = [\"t^2\", \"u.csv\", 3]\n";
  const auto with_f = [](const std::string& f) {
    return scene("\"zero(3)\"", "[[1], [0], [0]]", "[0, 0, 0]", "[[1, 0, 0]]", "1", f);
  };
  const Scene read_from = read(with_f(three)).scene;
  Vector f(3);
  for (const double t : {0.0, 0.5, 1.0, 1.75, 2.0}) {
    read_from.f(t, f);
    EXPECT_NEAR(f[0], t * t, 1e-15) << t;
    EXPECT_NEAR(f[1], 1 - std::abs(t - 1), 1e-15) << t;
    EXPECT_EQ(f[2], 3) << t;
  }
  EXPECT_EQ(read_from.breakpoints, (std::vector{1.0}));
  EXPECT_TRUE(read_from.breakpoints_are_all);
  write("two.csv", "t,f0,f1\n0,0,0\n2,0,0\n");
  write("short.csv", "t,f0\n0,0\n1,0\n");
  EXPECT_NE(refused(with_f("f = [0, \"two.csv\", 3]\n")).find("dynamics.f: the table '"), std::string::npos);
  EXPECT_NE(refused(with_f("f = [0, \"short.csv\", 3]\n")).find("the times end at 1, before T = 2"), std::string::npos);
  EXPECT_NE(refused(with_f("f = [0, \"none.csv\", 3]\n")).find("does not exist"), std::string::npos);
}

TEST_F(SceneFolder, MistakesOfFilesNameTheFile) {
  write("A.mtx", "%%MatrixMarket matrix coordinate real general\n1 1 1\n1 1 x\n");
  write("x0.csv", "1,2\n3,4\n");
  write("f.csv", "t,f0,f1\n0,0,0\n2,2,4\n");
  write("short.csv", "t,f0\n0,0\n1,2\n");
  const auto starts = [&](const std::string& text, const std::string& message) {
    EXPECT_TRUE(refused(text).starts_with(message)) << refused(text) << "\nexpected: " << message;
  };
  starts(scene("\"A.mtx\"", "[[1]]", "[0]", "[[1]]", "[[1]]"), path("A.mtx") + ":3: 'x' is no finite number");
  starts(scene("[[1]]", "\"B.mtx\"", "[0]", "[[1]]", "[[1]]"),
         path("my.toml") + ":3: dynamics.B: the file '" + path("B.mtx") + "' does not exist");
  starts(scene("[[1]]", "[[1]]", "\"x0.csv\"", "[[1]]", "[[1]]"),
         path("my.toml") + ":4: dynamics.x0: the file holds a matrix of 2 x 2");
  starts(scene("[[1]]", "[[1]]", "[0]", "[[1]]", "[[1]]", "f = \"f.csv\"\n"),
         path("my.toml") + ":5: dynamics.f: has 2 entries; give 1");
  starts(scene("[[1]]", "[[1]]", "[0]", "[[1]]", "[[1]]", "f = \"short.csv\"\n"),
         path("short.csv") + ":3: the times end at 1");
  fs::create_directory(folder_ / "folder.mtx");
  starts(scene("\"folder.mtx\"", "[[1]]", "[0]", "[[1]]", "[[1]]"), path("my.toml") + ":2: dynamics.A: '");
}

/// Matrices of `m` states in files, one constraint.
std::string sparse_scene(Index m) {
  std::string x0 = "[0";
  for (Index i = 1; i < m; ++i) x0 += ", 0";
  return scene("\"A.mtx\"", "\"B.mtx\"", x0 + "]", "\"N.mtx\"", "[[1]]");
}

TEST_F(SceneFolder, LargeSparseMatricesStaySparse) {
  for (const Index m : {256, 257}) {
    const std::string size = std::to_string(m), head = "%%MatrixMarket matrix coordinate real ";
    std::string entries;
    for (Index i = 1; i <= m; ++i) {
      entries += std::to_string(i) + " " + std::to_string(i) + " -2\n";
      if (i > 1) entries += std::to_string(i) + " " + std::to_string(i - 1) + " 1\n";
    }
    write("A.mtx", head + "symmetric\n" + size + " " + size + " " + std::to_string(2 * m - 1) + "\n" + entries);
    write("B.mtx", head + "general\n" + size + " 1 1\n1 1 1\n");
    write("N.mtx", head + "general\n1 " + size + " 1\n1 1 1\n");
    const SceneFile file = read(sparse_scene(m));
    EXPECT_EQ(holds<SparseDynamics>(file.scene.dynamics), m > 256) << m;
    const Matrix A = to_dense(file.scene.dynamics).A;
    EXPECT_EQ(A.diagonal(), Vector::Constant(m, -2));
    EXPECT_EQ(A.diagonal(1), Vector::Constant(m - 1, 1));
    EXPECT_EQ(A.squaredNorm(), 4. * double(m) + 2. * double(m - 1));  // and no other entries
    EXPECT_EQ(to_dense(file.scene.dynamics).B.col(0), Vector::Unit(m, 0));
  }
}

TEST_F(SceneFolder, LargeTridiagonalMIsKeptAsOne) {
  for (const Index n : {16, 17}) {
    const std::string size = std::to_string(n), head = "%%MatrixMarket matrix coordinate real ";
    std::string entries, ones;
    for (Index i = 1; i <= n; ++i) {
      entries += std::to_string(i) + " " + std::to_string(i) + " 4\n";
      if (i > 1) entries += std::to_string(i) + " " + std::to_string(i - 1) + " -" + std::to_string(i) + "\n";
      ones += i == 1 ? "1" : ",1";
    }
    write("M.mtx", head + "general\n" + size + " " + size + " " + std::to_string(2 * n - 1) + "\n" + entries);
    write("B.csv", ones + "\n");
    std::string column;
    for (Index i = 0; i < n; ++i) column += "1\n";
    write("N.csv", column);
    const SceneFile file = read(scene("[[-1]]", "\"B.csv\"", "[0]", "\"N.csv\"", "\"M.mtx\""));
    EXPECT_EQ(std::holds_alternative<Tridiagonal>(file.scene.M), n > 16) << n;
    const Matrix M = to_dense(file.scene.M);
    EXPECT_EQ(M.diagonal(), Vector::Constant(n, 4));
    EXPECT_EQ(M.diagonal(-1), Vector(-Vector::LinSpaced(n - 1, 2, double(n))));
    EXPECT_EQ(M.diagonal(1), Vector::Zero(n - 1));
  }
}

TEST_F(SceneFolder, MissingSceneFileIsNamed) {
  const std::string found = refusal([&] { read_scene_file(folder_ / "none.toml"); });
  EXPECT_TRUE(found.starts_with(path("none.toml") + ": the file '")) << found;
}

}  // namespace
}  // namespace bromwich
