// A file that is read once for many scenes: each of them is the one that is read alone, bit for bit.

#include "files/scene_reader.hpp"

#include "files/kept_values.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <vector>

namespace bromwich::scene_reader_test {
namespace {

namespace fs = std::filesystem;

template <class Matrices>
void expect_same_matrix(const Matrices& a, const Matrices& b, const char* name) {
  ASSERT_EQ(a.rows(), b.rows()) << name;
  ASSERT_EQ(a.cols(), b.cols()) << name;
  EXPECT_TRUE(Matrix(a) == Matrix(b)) << name;
}

void expect_same_dynamics(const Dynamics& a, const Dynamics& b) {
  constexpr Index most_written_out = 600;
  ASSERT_EQ(states(a), states(b));
  ASSERT_EQ(constraints(a), constraints(b));
  EXPECT_EQ(a.made_from<DenseDynamics>() != nullptr, b.made_from<DenseDynamics>() != nullptr);
  EXPECT_EQ(a.made_from<SparseDynamics>() != nullptr, b.made_from<SparseDynamics>() != nullptr);
  if (const auto* p = a.made_from<SparseDynamics>(), *q = b.made_from<SparseDynamics>(); p && q) {
    EXPECT_EQ(SparseMatrix(p->A - q->A).norm(), 0);
    EXPECT_EQ(SparseMatrix(p->B - q->B).norm(), 0);
    EXPECT_EQ(SparseMatrix(p->N - q->N).norm(), 0);
  } else if (states(a) <= most_written_out) {
    const DenseDynamics d = to_dense(a), e = to_dense(b);
    expect_same_matrix(d.A, e.A, "A"), expect_same_matrix(d.B, e.B, "B"), expect_same_matrix(d.N, e.N, "N");
    expect_same_matrix(d.E, e.E, "E");
  }
}

void expect_same_function(const TimeFunction& a, const TimeFunction& b, Index size, double T, const char* name) {
  ASSERT_EQ(bool(a), bool(b)) << name;
  if (!a) return;
  Vector p(size), q(size);
  for (const double part : {0.0, 0.11, 0.37, 0.5, 0.83, 1.0}) {
    a(part * T, p), b(part * T, q);
    EXPECT_TRUE(p == q) << name << " at " << part << " T";
  }
}

void expect_same(const SceneFile& a, const SceneFile& b) {
  const Scene &p = a.scene, &q = b.scene;
  expect_same_dynamics(p.dynamics, q.dynamics);
  if (testing::Test::HasFatalFailure()) return;
  ASSERT_EQ(p.M.index(), q.M.index());
  if (p.constraints() <= 600) expect_same_matrix(to_dense(p.M), to_dense(q.M), "M");
  EXPECT_EQ(p.lcp_class, q.lcp_class);
  EXPECT_EQ(p.f_entry, q.f_entry);
  expect_same_matrix(p.F, q.F, "F");
  EXPECT_EQ(p.T, q.T);
  EXPECT_EQ(p.default_steps, q.default_steps);
  ASSERT_EQ(p.x0.size(), q.x0.size());
  EXPECT_TRUE(p.x0 == q.x0);
  expect_same_function(p.f, q.f, p.sources(), p.T, "f");
  expect_same_function(p.g, q.g, p.constraints(), p.T, "g");
  EXPECT_EQ(p.breakpoints, q.breakpoints);
  EXPECT_EQ(p.breakpoints_are_all, q.breakpoints_are_all);
  EXPECT_EQ(p.free_rows, q.free_rows);
  EXPECT_EQ(p.relays, q.relays);
  ASSERT_EQ(bool(p.boundary), bool(q.boundary));
  if (p.boundary) expect_same_matrix(p.boundary->E0, q.boundary->E0, "E0");
  if (p.boundary) expect_same_matrix(Matrix(p.boundary->b), Matrix(q.boundary->b), "b");
  EXPECT_EQ(p.name, q.name);
  EXPECT_EQ(p.names.x, q.names.x);
  EXPECT_EQ(p.units.y, q.units.y);
  EXPECT_EQ(bool(p.exact), bool(q.exact));
  EXPECT_EQ(a.parameters, b.parameters);
  EXPECT_EQ(a.scene.default_tolerance, b.scene.default_tolerance);
  EXPECT_EQ(a.states, b.states);
  EXPECT_EQ(a.warning, b.warning);
  EXPECT_EQ(a.reference.has_value(), b.reference.has_value());
  EXPECT_EQ(bool(a.rectangle), bool(b.rectangle));
  const auto names = [](const SceneFile& file) { return std::set<fs::path>(file.inputs.begin(), file.inputs.end()); };
  EXPECT_EQ(names(a), names(b));
}

// The scene, or the refusal, of `kept` is that of a reader that has read nothing before.
void expect_as_alone(SceneReader& kept, const std::function<SceneReader()>& fresh, const ParameterValues& settings) {
  std::string said;
  for (const auto& [name, value] : settings) said += name + " = " + std::to_string(value) + " ";
  SCOPED_TRACE(said);
  SceneFile alone, again;
  const std::string refused_alone = refusal([&] { alone = fresh().linear(settings); });
  const std::string refused = refusal([&] { again = kept.linear(settings); });
  ASSERT_EQ(refused, refused_alone);
  if (refused == "nothing was refused") expect_same(again, alone);
}

std::vector<fs::path> examples() {
  std::vector<fs::path> found;
  for (const auto& entry : fs::recursive_directory_iterator(BROMWICH_EXAMPLES))
    if (entry.path().extension() == ".toml") found.push_back(entry.path());
  std::sort(found.begin(), found.end());
  return found;
}

// One parameter after the other, twice, and T: the second time most of a scene is there already.
TEST(SceneReader, ScenesOfEveryExampleAreThoseReadAlone) {
  for (const fs::path& path : examples()) {
    SCOPED_TRACE(path.filename().string());
    const auto fresh = [&] { return SceneReader(path); };
    SceneReader kept(path);
    expect_as_alone(kept, fresh, {});
    if (HasFatalFailure()) return;
    ParameterValues values;
    const std::string refused = refusal([&] { values = kept.nonlinear().file.parameters; });
    ASSERT_EQ(refused, "nothing was refused");
    if (!values.contains("T")) values["T"] = kept.nonlinear().file.scene.T;
    for (const double factor : {1.25, 0.5, 1.25, 0.0})
      for (const auto& [name, value] : values) expect_as_alone(kept, fresh, {{name, factor * value}});
    ParameterValues all;
    for (const auto& [name, value] : values) all[name] = 1.125 * value;
    expect_as_alone(kept, fresh, all);
    expect_as_alone(kept, fresh, {});
  }
}

class ReaderOfFiles : public testing::Test {
 protected:
  ReaderOfFiles() { fs::create_directories(folder_); }
  ~ReaderOfFiles() override { fs::remove_all(folder_); }
  void write(const std::string& name, const std::string& text) const { std::ofstream(folder_ / name) << text; }

  void expect_as_alone_for(const std::string& text, const std::vector<ParameterValues>& all) const {
    const auto fresh = [&] { return SceneReader(text, "s.toml", folder_); };
    SceneReader kept = fresh();
    for (int round = 0; round < 2; ++round)
      for (const ParameterValues& settings : all) expect_as_alone(kept, fresh, settings);
  }

  fs::path folder_ = fs::path(testing::TempDir()) / ("bromwich_reader_" + std::to_string(::getpid()));
};

// Definitions that hold values of parameters (pulse), parameters of parameters, one expression for all entries, matrix
// forms, tables, matrices in files, included files; refusals between the scenes.
const std::string of_all = R"toml(
include = "common.toml"
[parameters]
C = "3*R"
V = 2
width = 0.2
[definitions]
wave = "pulse(t, 0, V, 0.1, 0.05, 0.05, width, 0.5)"
twice = "2*wave + C*sin(3*t)"
[dynamics]
A = "A.csv"
B = [["1/R", 0], [0, "V"]]
f = "f.csv"
x0 = "V*(i + 1)/R"
[complementarity]
N = "identity(2)"
M = [["R", "0"], [0, "C/R"]]
g = ["twice", "-wave + V"]
[time]
T = 1
steps = 10
jumps = ["width/2"]
[names]
x = ["a", "b"]
[exact]
x = ["V*t", "C"]
)toml";

TEST_F(ReaderOfFiles, EveryKindOfInputFollowsItsParameters) {
  write("common.toml", "[parameters]\nR = 2\n[complementarity]\nclass = \"P\"\n");
  write("A.csv", "-1,0.5\n0,-2\n");
  write("f.csv", "t,f0,f1\n0,1,10\n0.5,3,10\n2,0,-20\n");
  expect_as_alone_for(of_all, {{},
                               {{"R", 4}},
                               {{"R", 0}},  // 1/R
                               {{"R", 4}},
                               {{"V", -0.0}},
                               {{"V", 0.0}},
                               {{"width", 0.1}},
                               {{"width", 0.9}},  // longer than the period
                               {{"T", 1.5}},
                               {{"T", 3}},  // the table ends before
                               {{"C", 1}, {"steps", 20}},
                               {{"steps", 2.5}},
                               {{"R", 4}, {"C", 12}},
                               {{"Q", 1}}});  // no parameter
}

TEST_F(ReaderOfFiles, RelaysAndRectanglesFollowTheirParameters) {
  expect_as_alone_for(R"toml(
[parameters]
a = 1
b = 2
c = 3
[dynamics]
A = [["-a"]]
B = [["b"]]
f = ["sin(c*t)"]
x0 = ["c"]
[relay]
C = [["a + b"]]
e = ["c*cos(t)"]
[time]
T = 2
)toml",
                      {{}, {{"a", 2}}, {{"b", 3}}, {{"c", 4}}, {{"T", 3}}, {{"a", 2}, {"c", 4}}, {}});
  expect_as_alone_for(R"toml(
[parameters]
n = 3
c = 0.5
b = 1
[kronecker]
points = "n"
spacing = 0.25
diffusivity = "c"
b = ["b"]
n = ["-b"]
[dynamics]
f = ["b*t", 0, 0]
x0 = "c*i + b*j"
[complementarity]
M = "tridiag(n, -1, 2 + c, -1)"
[time]
T = 2
)toml",
                      {{}, {{"n", 4}}, {{"c", 1}}, {{"b", 2}}, {{"n", 3}}, {{"c", -1}}, {}});
}

// Which parameter comes first is known to the file alone: a later one that was defined for a scene before is not known.
TEST_F(ReaderOfFiles, NamesOfAnotherSceneAreForgotten) {
  const std::string text =
      "[parameters]\nC = \"3*R\"\nR = 2\n[dynamics]\nA = [[-1]]\nB = [[1]]\nx0 = [\"C\"]\n[complementarity]\nN = "
      "[[1]]\nM = [[1]]\n[time]\nT = 1\n";
  expect_as_alone_for(text, {{{"C", 1}}, {}, {{"C", 2}, {"R", 3}}});
}

TEST(SceneReader, ScenesShareWhatNoChangedParameterEnters) {
  SceneReader reader(R"toml(
[parameters]
a = 1
b = 2
[dynamics]
A = [["-b"]]
B = [[1]]
x0 = ["a"]
[complementarity]
N = [[1]]
M = [["b"]]
[time]
T = 1
)toml",
                     "s.toml");
  const Scene one = reader.linear({{"a", 3}}).scene, two = reader.linear({{"a", 4}}).scene,
              three = reader.linear({{"b", 4}}).scene;
  EXPECT_EQ(&*one.dynamics, &*two.dynamics);
  EXPECT_NE(&*one.dynamics, &*three.dynamics);
}

TEST(SceneReader, SourcesWithOneNumberAreTheSame) {
  SceneReader reader(R"toml(
[parameters]
a = 1
b = 2
c = 3
d = 4
[definitions]
wave = "sin(c*t)"
[dynamics]
A = [["-b"]]
B = [[1]]
f = ["wave"]
x0 = ["a"]
[complementarity]
N = [[1]]
M = [["b"]]
g = ["max(cos(3*t), 0)"]
[time]
T = 1
jumps = ["d/10"]
)toml",
                     "s.toml");
  const auto number = [&](const ParameterValues& settings) {
    reader.linear(settings);
    return reader.sources();
  };
  const Index first = number({});
  EXPECT_EQ(number({{"a", 3}}), first);
  EXPECT_EQ(number({{"b", 3}}), first);
  EXPECT_NE(number({{"c", 4}}), first);
  EXPECT_NE(number({{"d", 5}}), first);
  EXPECT_NE(number({{"T", 2}}), first);
  const Index again = number({});
  EXPECT_EQ(number({{"a", 3}, {"b", 1}}), again);
}

TEST(KeptValues, AreMadeAgainWhereWhatTheyUsedHasAnotherMeaning) {
  Meanings now{{{"a", 1}, {"b", 2}, {"c", 3}}, {{"s", "sin(t)"}}};
  KeptValues kept(now);
  int inner = 0, outer = 0;
  const auto make = [&] {
    return kept.get("outer", {}, [&] {
      ++outer;
      const double b = kept.get("inner", {}, [&] {
        ++inner;
        kept.use("b");
        return now.parameters.at("b");
      });
      kept.use("s");
      return b;
    });
  };
  const auto expect = [&](double value, int inners, int outers) {
    EXPECT_EQ(make(), value);
    EXPECT_EQ(inner, inners);
    EXPECT_EQ(outer, outers);
  };
  expect(2, 1, 1);
  now.parameters["a"] = 5;
  expect(2, 1, 1);
  now.parameters["c"] = 4;
  expect(2, 1, 1);
  now.definitions["s"] = "cos(c*t)";
  expect(2, 1, 2);
  now.parameters["c"] = 5;  // what a definition uses is used
  expect(2, 1, 3);
  now.parameters["b"] = 0.0;  // the outer value uses what the inner one uses, also where that was kept
  expect(0, 2, 4);
  now.parameters["b"] = -0.0;
  expect(0, 3, 5);
  now.parameters.erase("b");
  EXPECT_THROW(make(), std::out_of_range);
  now.parameters["b"] = -0.0;
  expect(0, 4, 6);
}

TEST(KeptValues, DependOnWhatIsGivenAndOnTheKey) {
  const Meanings now;
  KeptValues kept(now);
  int made = 0;
  const auto get = [&](const char* key, double given) { return kept.get(key, {given}, [&] { return ++made; }); };
  EXPECT_EQ(get("a", 1), 1);
  EXPECT_EQ(get("a", 1), 1);
  EXPECT_EQ(get("b", 1), 2);
  EXPECT_EQ(get("a", 2), 3);
  EXPECT_EQ(get("a", 1), 4);
}

}  // namespace
}  // namespace bromwich::scene_reader_test
