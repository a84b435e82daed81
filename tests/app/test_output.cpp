// Files of --out in all formats, killed and restarted runs, full disks.

#include "app/times_of_run.hpp"
#include "core/result/estimated_quantity.hpp"
#include "files/stored_result.hpp"
#include "tests/app/cli.hpp"
#include "tests/files/hdf5_reading.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {
namespace {

const std::string heat = "solve signorini --set Q=7 --threads 1 ";

/// The numbers of a CSV file below its header.
RowMatrix table(const fs::path& path) {
  const std::vector<std::string> lines = split(read(path), '\n');
  const auto width = Index(split(lines.at(0), ',').size());
  RowMatrix values(Index(lines.size()) - 1, width);
  for (Index j = 0; j < values.rows(); ++j) {
    const std::vector<std::string> words = split(lines[std::size_t(j) + 1], ',');
    for (Index i = 0; i < width; ++i) values(j, i) = std::stod(words.at(std::size_t(i)));
  }
  return values;
}

double distance(const RowMatrix& a, const RowMatrix& b) {
  if (a.rows() != b.rows() || a.cols() != b.cols()) return INFINITY;
  return a.size() == 0 ? 0 : (a - b).cwiseAbs().maxCoeff<Eigen::PropagateNaN>();
}

/// Rounding of the same discrete problem in other orders: the heat equation damps what was before, so that errors are
/// those of one part, 64 to 16384 steps with products of at most 49 terms of size 12; states at the end of a part come
/// from contours to 1e-12 of them.
constexpr double same = 1e-11;

class CliOutput : public Cli {};

// The command without its part for HDF5: it solves, and says what is missing before it computes.
TEST_F(CliOutput, WithoutItsPartForHdf5TheCommandSaysSo) {
  fs::create_directories(folder_ / "alone");
  fs::copy_file(BROMWICH_CLI, folder_ / "alone/bromwich");
  const std::string copy = "f() { shift; alone/bromwich \"$@\"; }; f";  // in place of the path of the command
  EXPECT_EQ(run(heat + "--steps 50 --out r.csv", copy).exit_code, 0);
  const Outcome missing = run(heat + "--steps 50 --out r.h5", copy);
  EXPECT_EQ(missing.exit_code, 2);
  EXPECT_EQ(missing.out, "");
  EXPECT_TRUE(contains(missing.err, "--out: 'r.h5' needs HDF5, and a part of this program")) << missing.err;
  EXPECT_TRUE(contains(missing.err, "bromwich_hdf5.so: cannot open")) << missing.err;
  EXPECT_EQ(std::count(missing.err.begin(), missing.err.end(), '\n'), 1) << missing.err;
  // A file that is none.
  std::ofstream(folder_ / "alone/bromwich_hdf5.so") << "part";
  const Outcome broken = run(heat + "--steps 50 --out r.h5", copy);
  EXPECT_EQ(broken.exit_code, 2);
  EXPECT_TRUE(contains(broken.err, "cannot be loaded")) << broken.err;
  EXPECT_FALSE(fs::exists(folder_ / "r.h5"));
}

TEST_F(CliOutput, AllFormatsHoldTheSameNumbers) {
  const std::string options = heat + "--steps 50 --states all --out ";
  for (const std::string name : {"r.csv", "r.h5", "r.npz", "r.vtkhdf"}) {
    const Outcome outcome = run(options + name);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_TRUE(contains(outcome.out, name)) << outcome.out;
  }
  const RowMatrix csv = table(folder_ / "r.csv");
  const Hdf5Reading h5(folder_ / "r.h5"), grid(folder_ / "r.vtkhdf");
  EXPECT_EQ(h5.rows("t"), csv.col(0));
  EXPECT_EQ(h5.rows("y"), csv.middleCols(1, 7));
  EXPECT_EQ(h5.rows("x"), csv.rightCols(49));
  EXPECT_EQ(grid.rows("VTKHDF/PointData/x"), csv.rightCols(49));
  EXPECT_EQ(grid.rows("VTKHDF/Steps/Values"), csv.col(0));
  const RowMatrix y = h5.rows("y"), w = h5.rows("w");
  EXPECT_LE(y.cwiseMin(w).cwiseAbs().maxCoeff(), 1e-12);  // complementary: the residual is 1e-15 of sizes below 12
  EXPECT_GT(w.maxCoeff(), 1);
  EXPECT_EQ(h5.text("status"), "solved");
  EXPECT_EQ(h5.text("scene"), "signorini");
  EXPECT_EQ(h5.text("command"), "bromwich " + options + "r.h5");
  EXPECT_EQ(h5.number("/", "steps"), 50);
  EXPECT_TRUE(read(folder_ / "r.npz").starts_with("PK"));
  EXPECT_EQ(files(), 4u);
}

TEST_F(CliOutput, RectanglesAreGrids) {
  const std::string plate = BROMWICH_EXAMPLES "/heated-plate.toml";
  const Outcome outcome = run("solve " + plate + " --steps 20 --states all --out p.vtkhdf");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(Hdf5Reading(folder_ / "p.vtkhdf").shape("VTKHDF/PointData/x"), (std::vector<hsize_t>{21, 5, 7}));
  const Outcome checked = run("check p.vtkhdf"), plotted = run("plot p.vtkhdf");
  EXPECT_EQ(checked.exit_code, 0) << checked.err;
  EXPECT_TRUE(contains(checked.out, "21 rows") && contains(checked.out, "10 columns")) << checked.out;
  EXPECT_EQ(plotted.exit_code, 0) << plotted.err;
}

TEST_F(CliOutput, EnergiesInAllFormats) {
  const std::string options = "solve ladder --set n=3 --steps 20 --states all --energies --threads 1 --out ";
  for (const std::string name : {"e.csv", "e.h5", "e.npz"}) {
    const Outcome outcome = run(options + name);
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  }
  const std::vector<std::string> header = split(split(read(folder_ / "e.csv"), '\n').at(0), ',');
  const RowMatrix csv = table(folder_ / "e.csv");
  const Hdf5Reading h5(folder_ / "e.h5");
  for (const std::string name :
       {"energy", "supplied_power", "dissipated_power", "supplied", "dissipated", "violation"}) {
    const auto at = std::find(header.begin(), header.end(), name);
    ASSERT_NE(at, header.end()) << name;
    EXPECT_EQ(h5.rows(name), csv.col(at - header.begin())) << name;
    EXPECT_TRUE(contains(read(folder_ / "e.npz"), name + ".npy")) << name;
  }
}

TEST_F(CliOutput, ContactsInAllFormats) {
  std::ofstream(folder_ / "s.toml") << "[structure]\nM = 1\nK = [[1]]\nf = [\"0.5*sin(t)\"]\n[[contact]]\nname = "
                                       "\"pad\"\ntangent = [1]\nbound = 0.2\n[time]\nT = 6\nsteps = 60\n";
  for (const std::string name : {"c.csv", "c.h5", "c.npz"}) {
    const Outcome outcome = run("solve s.toml --method events --states all --out " + name);
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  }
  const auto column = [&](const std::string& file, const std::string& name) {
    const std::vector<std::string> header = split(split(read(folder_ / file), '\n').at(0), ',');
    return Vector(table(folder_ / file).col(std::find(header.begin(), header.end(), name) - header.begin()));
  };
  const Vector lt = column("c.csv", "pad.lt"), state = column("c.csv", "pad.state"), v = column("c.csv", "v_q0");
  for (Index j = 1; j < lt.size(); ++j) {
    if (state[j] == 1) EXPECT_NEAR(v[j], 0, 1e-9);
    if (state[j] == 2) EXPECT_NEAR(lt[j], v[j] > 0 ? -0.2 : 0.2, 1e-9);
  }
  EXPECT_EQ((state.array() == 1).count() + (state.array() == 2).count(), lt.size());
  const Hdf5Reading h5(folder_ / "c.h5");
  EXPECT_EQ(h5.rows("pad.lt"), lt);
  EXPECT_EQ(h5.rows("pad.state"), state);
  for (const char* name : {"pad.lt.npy", "pad.state.npy"}) EXPECT_TRUE(contains(read(folder_ / "c.npz"), name)) << name;
  // The columns ask for the states that they need.
  ASSERT_EQ(run("solve s.toml --method events --columns pad.state,pad.lt --out d.csv").exit_code, 0);
  EXPECT_EQ(table(folder_ / "d.csv").rightCols(2), (RowMatrix(lt.size(), 2) << state, lt).finished());
  ASSERT_EQ(run("plot c.h5 --out p.html").exit_code, 0);
  EXPECT_TRUE(contains(read(folder_ / "p.html"), "Phase plane"));
  EXPECT_TRUE(contains(run("check c.h5").out, "balance of energy"));
}

TEST_F(CliOutput, ResultsAreDrawnAndChecked) {
  ASSERT_EQ(run(heat + "--steps 40 --states 0,3 --out r.csv --json > r.json").exit_code, 0);
  ASSERT_EQ(run(heat + "--steps 40 --states 0,3 --out r.h5").exit_code, 0);
  ASSERT_EQ(run(heat + "--steps 40 --states 0,3 --out r.npz").exit_code, 0);
  const auto curves = [&](const std::string& name, const std::string& more = "") {
    const Outcome outcome = run("plot " + name + more + " --out p.html");
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    const std::string page = read(folder_ / "p.html");
    EXPECT_TRUE(contains(page, "<strong>solved</strong>")) << name;
    EXPECT_TRUE(contains(page, "x3")) << name;
    return page;
  };
  EXPECT_TRUE(contains(curves("r.h5"), "complementarity residual"));
  EXPECT_TRUE(contains(curves("r.npz"), "complementarity residual"));
  curves("r.csv", " --summary r.json");
  for (const std::string name : {"r.h5", "r.npz"}) {
    const Outcome outcome = run("check " + name);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_TRUE(contains(outcome.out, "41 rows")) << outcome.out;
    EXPECT_TRUE(contains(outcome.out, "status      solved")) << outcome.out;
  }
  std::ofstream(folder_ / "ends.toml") << "[dynamics]\nA = [[0]]\nB = [[0]]\nx0 = [0]\n[complementarity]\nN = [[0]]\n"
                                          "M = [[0]]\ng = [\"0.5 - t\"]\n[time]\nT = 1\nsteps = 20\n";
  run("solve ends.toml --method march --out e.h5");
  EXPECT_EQ(run("check e.h5").exit_code, 3);
  for (const std::string name : {"no.h5", "no.npz"}) std::ofstream(folder_ / name) << "not this";
  for (const std::string name : {"no.h5", "no.npz", "none.h5", "none.npz"}) {
    const Outcome outcome = run("plot " + name);
    EXPECT_EQ(outcome.exit_code, 2) << name;
    EXPECT_TRUE(contains(outcome.err, name)) << outcome.err;
  }
}

TEST_F(CliOutput, OtherTimesAndEarlyEnds) {
  ASSERT_EQ(run(heat + "--steps 40 --at 0.5,1.05 --out a.h5").exit_code, 0);
  ASSERT_EQ(run(heat + "--steps 40 --at 0.5,1.05 --out a.csv").exit_code, 0);
  EXPECT_EQ(Hdf5Reading(folder_ / "a.h5").rows("y"), table(folder_ / "a.csv").rightCols(7));

  std::ofstream(folder_ / "ends.toml") << "[dynamics]\nA = [[0]]\nB = [[0]]\nx0 = [0]\n[complementarity]\nN = [[0]]\n"
                                          "M = [[0]]\ng = [\"1 - t\"]\n[time]\nT = 2\nsteps = 20\n";
  EXPECT_EQ(run("solve ends.toml --method march --out e.h5").exit_code, 3);
  const Hdf5Reading ended(folder_ / "e.h5");
  EXPECT_EQ(ended.text("status"), "infeasible");
  EXPECT_NE(ended.text("reason"), "");
  EXPECT_EQ(ended.text("scene_file"), read(folder_ / "ends.toml"));
  const RowMatrix t = ended.rows("t"), y = ended.rows("y");
  ASSERT_GE(t.rows(), 9);
  EXPECT_LE(t(t.rows() - 1, 0), 1.0);
  EXPECT_TRUE(y.allFinite());
  EXPECT_EQ(ended.number("/", "t_end"), t(t.rows() - 1, 0));
}

TEST_F(CliOutput, PartsAreOneRun) {
  const std::string options = heat + "--steps 1500 --states 0,24,48 --method march --out ";
  ASSERT_EQ(run(options + "whole.h5").exit_code, 0);
  ASSERT_EQ(run(options + "parts.h5 --checkpoint c.h5").exit_code, 0);
  const Hdf5Reading whole(folder_ / "whole.h5"), parts(folder_ / "parts.h5");
  EXPECT_EQ(whole.rows("t"), parts.rows("t"));
  for (const std::string name : {"y", "w", "x"}) EXPECT_LE(distance(whole.rows(name), parts.rows(name)), same) << name;
  EXPECT_TRUE(contains(refused(options + "again.h5 --restart c.h5").err, "reached its end"));
}

// Sweeps end at a change of 1e-12; the parts have 256 steps and more.
TEST_F(CliOutput, PartsOfMethodsOverAllTimePointsAreOneRun) {
  for (const std::string method : {"contour", "multigrid"}) {
    const std::string options =
        "solve signorini --set Q=15 --steps 1500 --states 0,24,48 --method " + method + " --out ";
    ASSERT_EQ(run(options + "whole.h5").exit_code, 0);
    const Outcome in_parts = run(options + "parts.h5 --checkpoint c.h5 --checkpoint-every 0.001");
    ASSERT_EQ(in_parts.exit_code, 0) << in_parts.err;
    const Hdf5Reading whole(folder_ / "whole.h5"), parts(folder_ / "parts.h5");
    EXPECT_EQ(whole.rows("t"), parts.rows("t"));
    for (const std::string name : {"y", "w", "x"})
      EXPECT_LE(distance(whole.rows(name), parts.rows(name)), same) << method << ", " << name;
  }
}

TEST_F(CliOutput, AKilledRunIsReadAndContinued) {
  const std::string options = heat + "--steps 60000 --states 0 --method march ";
  ASSERT_EQ(run(options + "--out whole.h5").exit_code, 0);
  const Hdf5Reading whole(folder_ / "whole.h5");
  int continued = 0;
  for (const std::string seconds : {"0.05", "0.15", "0.25", "0.35", "0.6"}) {
    for (const std::string name : {"k.h5", "c.h5"}) fs::remove(folder_ / name);
    const std::string files = "--checkpoint c.h5 --checkpoint-every 0.03 --out k.h5 ";
    if (run(options + files, "timeout --foreground -s KILL " + seconds).exit_code == 0) continue;  // too late
    if (!fs::exists(folder_ / "k.h5") || fs::file_size(folder_ / "k.h5") == 0) continue;  // killed before it began
    {
      const Hdf5Reading killed(folder_ / "k.h5");
      ASSERT_TRUE(killed.readable());
      if (!killed.has("x")) continue;  // killed while the empty file was made
      const Index written = killed.rows("t").rows();
      EXPECT_EQ(killed.text("status"), written < 60001 ? "running" : killed.text("status"));
      // Killed within a flush: the number of rows is there, and not yet all values.
      const StoredResult read = read_hdf5({"FILE", folder_ / "k.h5"});
      const Index rows = read.t.size();
      EXPECT_LE(rows, written);
      EXPECT_LE(read.t.size() > 0 ? distance(whole.rows("t").topRows(rows), read.t) : 0, 0);
      EXPECT_LE(distance(whole.rows("y").topRows(rows), read.y), same);
    }
    if (!fs::exists(folder_ / "c.h5")) continue;
    const Outcome rest = run(options + files + "--restart c.h5");
    if (rest.exit_code == 2 && contains(rest.err, "reached its end")) continue;
    ASSERT_EQ(rest.exit_code, 0) << rest.err;
    const Hdf5Reading all(folder_ / "k.h5");
    EXPECT_EQ(all.text("status"), "solved");
    EXPECT_EQ(all.rows("t"), whole.rows("t"));
    for (const std::string name : {"y", "w", "x"}) EXPECT_LE(distance(whole.rows(name), all.rows(name)), same) << name;
    ++continued;
  }
  RecordProperty("continued", continued);
}

// f and g may jump at time points, and just beside them they have their values from that side.
TEST(TimesOfRun, TimePointsOfPartsAreThoseOfTheRun) {
  const double T = 0.1;
  const Index J = 200000;
  const auto time = [=](Index j) { return double(j) * T / double(J); };
  Index rounded = 0;
  for (const Index begin : {0, 4096, 61440, 135168}) {
    const Index steps = 4096;
    const app::TimesOfRun times{T, J, begin, time(begin + steps) - time(begin), steps};
    std::vector<double> breakpoints;
    for (Index k = 0; k <= steps; ++k) {
      const double s = times.length * double(k) / double(steps), at = time(begin + k);
      ASSERT_EQ(times.of(s), at);
      rounded += time(begin) + s != at;
      const double beside = 256 * epsilon * times.length;
      EXPECT_TRUE(k == 0 || times.of(s - beside) < at);
      EXPECT_GT(times.of(s + beside), at);
      breakpoints.push_back(at);
    }
    const std::vector<double> inside = times.in_part(breakpoints);
    ASSERT_EQ(Index(inside.size()), steps - 1);
    EXPECT_EQ(inside[7], times.length * 8 / double(steps));
  }
  EXPECT_GT(rounded, 100) << "the sum of both times would do";
}

TEST_F(CliOutput, AStoppedRunIsContinued) {
  const std::string options = heat + "--steps 400000 --method march ";
  const Outcome stopped =
      run(options + "--checkpoint c.h5 --checkpoint-every 100 --out k.h5", "timeout --foreground -s TERM 0.3");
  if (!fs::exists(folder_ / "c.h5")) GTEST_SKIP() << "stopped before the first part, or after the last";
  {
    const Hdf5Reading part(folder_ / "k.h5");
    EXPECT_EQ(part.text("status"), "interrupted");
    EXPECT_TRUE(part.rows("y").allFinite());
    // The time of the run, not that of the part: within a step of the last row, in ten digits.
    const std::string at = "stopped on request at t = ", reason = part.text("reason");
    ASSERT_TRUE(reason.starts_with(at)) << reason;
    const RowMatrix t = part.rows("t");
    EXPECT_NEAR(std::stod(reason.substr(at.size())), t(t.rows() - 1), 1.01 * (t(1) - t(0))) << reason;
  }
  // A new file gets the rest alone.
  ASSERT_EQ(run(options + "--restart c.h5 --out rest.h5").exit_code, 0);
  ASSERT_EQ(run(options + "--restart c.h5 --out k.h5").exit_code, 0);
  const Hdf5Reading all(folder_ / "k.h5"), rest(folder_ / "rest.h5");
  EXPECT_EQ(all.rows("t").rows(), 400001);
  const Index rows = rest.rows("t").rows();
  EXPECT_EQ(all.rows("t").bottomRows(rows), rest.rows("t"));
  EXPECT_LE(distance(all.rows("w").bottomRows(rows), rest.rows("w")), same);
}

TEST_F(CliOutput, WhatCannotBeContinuedIsRefused) {
  std::ofstream(folder_ / "sliding.toml")  // M = 0: steps after a jump depend on those before
      << "[dynamics]\nA = [[0]]\nB = [[1]]\nx0 = [1]\nf = [\"-1\"]\n[complementarity]\nN = [[1]]\nM = [[0]]\n"
         "[time]\nT = 2\nsteps = 200\n";
  ASSERT_EQ(run(heat + "--steps 200 --checkpoint c.h5").exit_code, 0);
  const std::vector<BadInput> cases{
      {heat + "--tol 1e-3 --checkpoint d.h5", {"--checkpoint", "tolerance", "--steps"}},
      {heat + "--method dual --checkpoint d.h5", {"--checkpoint", "dual", "march"}},
      {heat + "--checkpoint d.h5 --out y.csv", {"--out", "y.csv", ".h5"}},
      {heat + "--checkpoint d.h5 --out y.npz", {"--out", "y.npz", ".h5"}},
      {heat + "--checkpoint d.h5 --out d.h5", {"--checkpoint", "d.h5", "--out"}},
      {heat + "--checkpoint d.csv", {"--checkpoint", "d.csv", ".h5"}},
      {heat + "--checkpoint d.h5 --switches s.csv", {"--checkpoint", "--switches"}},
      {heat + "--checkpoint d.h5 --at 1 --out y.h5", {"--checkpoint", "--at"}},
      {heat + "--checkpoint-every 3", {"--checkpoint-every", "without --checkpoint"}},
      {heat + "--checkpoint d.h5 --checkpoint-every 0", {"--checkpoint-every", "'0'"}},
      {heat + "--restart none.h5", {"--restart", "none.h5", "does not exist"}},
      {heat + "--steps 300 --restart c.h5", {"--restart", "300 steps", "200 steps"}},
      {"solve lq-control --checkpoint d.h5", {"--checkpoint", "boundary"}},
      {"solve sliding.toml --method march --checkpoint d.h5", {"--checkpoint", "euler"}},
      {"solve bridge --out y.vtkhdf", {"--out", "y.vtkhdf", "grid", ".h5"}},
      {heat + "--states 0,1 --out y.vtkhdf", {"--out", "y.vtkhdf", "--states all"}},
      {heat + "--out y.mat", {"--out", "y.mat", ".csv, .h5, .npz or .vtkhdf"}},
      {"solve ph-toy --method goal --states all --energies --out y.vtkhdf", {"--energies", ".csv"}},
  };
  for (const BadInput& bad : cases) {
    const Outcome result = refused(bad.arguments);
    for (const std::string& word : bad.mentions) EXPECT_TRUE(contains(result.err, word)) << word << "\n" << result.err;
  }
  EXPECT_EQ(run("solve sliding.toml --method euler --checkpoint d.h5").exit_code, 0);
  // That is only known from the first part.
  refused("solve sliding.toml --method march --checkpoint d.h5 --out f.h5");
  EXPECT_EQ(Hdf5Reading(folder_ / "f.h5").text("status"), "failed");
  std::ofstream(folder_ / "c.h5") << "no checkpoint";
  EXPECT_TRUE(contains(refused(heat + "--restart c.h5").err, "--restart"));
}

TEST_F(CliOutput, FullDisksLeaveWhatWasThere) {
  // Growing files keep whole chunks; the others are written whole or not at all.
  const std::string options = heat + "--steps 40000 --states all --method march --out ";
  const Outcome outcome = run(options + "r.h5", "ulimit -f 2000 &&");
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_TRUE(contains(outcome.err, "could not be written (File too large)")) << outcome.err;
  const Hdf5Reading partial(folder_ / "r.h5");
  ASSERT_TRUE(partial.readable());
  const Index rows = partial.rows("t").rows();
  EXPECT_LT(rows, 40001);
  for (const std::string name : {"y", "w", "x"}) {
    EXPECT_EQ(partial.rows(name).rows(), rows) << name;
    EXPECT_TRUE(partial.rows(name).allFinite()) << name;
  }
  std::ofstream(folder_ / "r.npz") << "precious";
  EXPECT_TRUE(contains(run(options + "r.npz", "ulimit -f 8 &&").err, "could not be written (File too large)"));
  EXPECT_EQ(read(folder_ / "r.npz"), "precious");
  EXPECT_EQ(files(), 2u);
}

TEST(EstimatedQuantity, SaysWhatTheEstimateIsOf) {
  Result r;
  EXPECT_EQ(estimated_quantity(r), "") << "no estimate";
  r.error_estimate = 1e-3;
  r.method = Method::multigrid;
  EXPECT_EQ(estimated_quantity(r), "y") << "of grids of multigrid";
  r.method = Method::events;
  r.x = RowMatrix::Zero(2, 1);
  EXPECT_EQ(estimated_quantity(r), "y and x");
  r.continuous = false;
  EXPECT_EQ(estimated_quantity(r), "the mean of y over [0, t] and x");
  r.errors.emplace();
  r.errors->discretisation = 1e-3;
  EXPECT_EQ(estimated_quantity(r), "y") << "located events control y although it jumps";
  r.errors->of_integral = true;
  EXPECT_EQ(estimated_quantity(r), "the mean of y over [0, t]");
  r.errors->states = 1e-4;
  EXPECT_EQ(estimated_quantity(r), "the mean of y over [0, t] and x");
  r.errors->discretisation = 0.1;  // above the estimate: with --tol-x y is not controlled
  EXPECT_EQ(estimated_quantity(r), "x");
}

}  // namespace
}  // namespace bromwich
