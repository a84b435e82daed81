// The studies of `bromwich bench` at their smallest sizes: output is complete and consistent.

#include "files/scene_file.hpp"
#include "tests/app/cli.hpp"

#include <nlohmann/json.hpp>

#include <cmath>
#include <map>

namespace bromwich {
namespace {

using Json = nlohmann::json;

class Bench : public Cli {
 protected:
  Json study(const std::string& arguments) const {
    const Outcome result = run("bench " + arguments + " --quick --threads 1 --out study.json");
    EXPECT_EQ(result.exit_code, 0) << result.err;
    const Json json = Json::parse(read(folder_ / "study.json"));
    EXPECT_EQ(json["schema"], "bromwich-bench/1");
    for (const char* key :
         {"bench", "parameters", "machine", "compiler", "flags", "commit", "version", "date", "details"})
      EXPECT_TRUE(json.contains(key)) << key;
    for (const Json& note : json["notes"]) EXPECT_TRUE(contains(result.out, text_after_colon(note))) << note;
    return json;
  }

  static std::string text_after_colon(const std::string& note) { return note.substr(note.find(": ") + 2); }

  // Errors of one contestant by number of steps.
  static std::map<long, double> errors(const Json& study, const std::string& contestant, const char* of) {
    std::map<long, double> found;
    for (const Json& row : study["rows"])
      if (row["contestant"] == contestant) found[row["steps"]] = row["error"][of]["max"];
    return found;
  }
};

TEST_F(Bench, BaselinesWritesItsSchema) {
  const Json json = study("baselines signorini --set Q=7 --steps 32");
  EXPECT_EQ(json["bench"], "baselines");
  EXPECT_EQ(json["scene"], "signorini");
  EXPECT_EQ(json["repeats"], 2);
  EXPECT_EQ(json["threads"], 1);
  for (const char* key : {"cpu", "cores", "memory"}) EXPECT_TRUE(json["machine"].contains(key)) << key;
  ASSERT_EQ(json["rows"].size(), 6u);
  for (const Json& row : json["rows"]) {
    for (const char* key :
         {"contestant", "method", "steps", "iterations", "error_max", "error_rms", "residual", "bytes"})
      EXPECT_TRUE(row.contains(key)) << key;
    EXPECT_LE(row["seconds"]["min"], row["seconds"]["median"]);
    EXPECT_LE(row["seconds"]["median"], row["seconds"]["max"]);
    // The stopping rule of the paper leaves an error of the order of its tolerance, min(1/8, 1/64)/50 here; implicit
    // Euler with h = 1/8 is first order: everything stays below one.
    EXPECT_LT(row["error_max"], 1) << row;
  }
}

// The model of docs/slabs.md by hand: without messages and carries ranks are free, with them each costs what it says.
TEST_F(Bench, ScaleIsItsModel) {
  const std::string sizes = "scale signorini --steps 8192 --set Q=15 point=1e-8 ";
  const Json free = study(sizes + "carry=0 latency=0 bandwidth=1e300"),
             dear = study(sizes + "carry=0.25 latency=1e-4 bandwidth=1e6");
  ASSERT_EQ(free["rows"].size(), 6u);
  const double K = dear["details"]["exponentials"], J = 8192, n = 15;
  for (std::size_t i = 0; i < 6; ++i) {
    const Json &cheap = free["rows"][i], &row = dear["rows"][i];
    const double R = row["ranks"], work = 1e-8 * n * J / R;
    EXPECT_NEAR(cheap["sweep"], work, 1e-12 * work);
    EXPECT_GE(double(row["bytes"]), R > 1 ? 8 * n * (K + 1) : 0);
    EXPECT_NEAR(row["sweep"], R == 1 ? work : 1.25 * work + 1e-4 * (1 + std::log2(R)) + 1e-6 * double(row["bytes"]),
                1e-12 * double(row["sweep"]));
    EXPECT_LE(double(row["strong"]), double(cheap["strong"]) + 1e-12);
  }
  EXPECT_EQ(free["rows"][0]["strong"], 1);
  EXPECT_EQ(dear["rows"][1]["bytes"], 8 * n * (K + 1)) << "two ranks have nobody else to tell";
  EXPECT_TRUE(contains(refused("bench scale --quick --set latency=-1").err, "latency"));
  EXPECT_TRUE(contains(refused("bench scale --quick").err, "mpirun"));
}

TEST_F(Bench, SpeedVsErrorFindsTheOrdersOfTheMethods) {
  const Json json = study("speed-vs-error dlcp-small");
  EXPECT_EQ(json["bench"], "speed-vs-error");
  for (const char* of : {"y", "trace"}) {
    // The exact solution is known: halving the step divides errors by 4 and 2, apart from the positions of kinks.
    const auto march = errors(json, "march", of), euler = errors(json, "euler", of);
    ASSERT_TRUE(march.contains(64) && march.contains(128)) << of;
    ASSERT_TRUE(euler.contains(64) && euler.contains(128)) << of;
    EXPECT_NEAR(std::log2(march.at(64) / march.at(128)), 2, 0.3) << of;
    EXPECT_NEAR(std::log2(euler.at(64) / euler.at(128)), 1, 0.3) << of;
    const auto contour = errors(json, "contour", of);
    ASSERT_TRUE(contour.contains(32)) << of;
    EXPECT_NEAR(contour.at(32) / march.at(32), 1, 1e-6) << of;  // the same discretisation
  }
  for (const Json& row : json["rows"]) {
    EXPECT_EQ(row["reference"], "the exact solution");
    EXPECT_EQ(row["threads"], 1);
    if (row["status"] != "solved") continue;
    EXPECT_LE(row["seconds"]["min"], row["seconds"]["median"]);
    EXPECT_LE(row["seconds"]["median"], row["seconds"]["max"]);
  }
  EXPECT_FALSE(json["notes"].empty());
}

TEST_F(Bench, SpeedVsErrorSaysHowFarItsReferenceIsKnown) {
  const Json json = study("speed-vs-error signorini --set Q=7");
  ASSERT_FALSE(json["rows"].empty());
  const double known_to = json["rows"][0]["reference_known_to"]["y"]["max"];
  EXPECT_GT(known_to, 0);
  for (const Json& row : json["rows"]) EXPECT_EQ(row["reference_known_to"]["y"]["max"], known_to);
  const auto euler = errors(json, "euler", "y");
  ASSERT_TRUE(euler.contains(32));
  EXPECT_GT(euler.at(32), 100 * known_to);
  // The same reference for all rows, with far more steps.
  EXPECT_EQ(json["rows"][0]["reference"], "march with 4096 steps");
}

TEST_F(Bench, TolSetsEstimatesBesideTrueErrors) {
  const Json json = study("tol dlcp-small");
  ASSERT_EQ(json["rows"].size(), 3u);
  for (const Json& row : json["rows"]) {
    EXPECT_EQ(row["status"], "solved") << row;
    EXPECT_EQ(row["reference"], "the exact solution");
    for (const char* of : {"y", "x"}) {
      EXPECT_LE(row["error"][of], row["tolerance"]);
      // The estimate is the difference of two solutions of third order, of which the finer one is the result.
      EXPECT_GE(row["effectivity"][of], 0.9) << row;
      EXPECT_LE(row["effectivity"][of], 8) << row;
    }
    const double parts = row["parts"]["discretisation"].get<double>() + row["parts"]["rounding"].get<double>() +
                         row["parts"]["iteration"].get<double>();
    EXPECT_NEAR(row["estimate"]["y"].get<double>(), parts, 1e-12) << "and the kernel, where it is compared, to 1e-13";
    long work = 0;
    for (const Json& steps : row["grids"]) work += steps.get<long>();
    EXPECT_EQ(row["work"], work);
  }
}

TEST_F(Bench, TolMeasuresTheMeanWhereYJumps) {
  if (!scene_files_available()) GTEST_SKIP() << "this build reads no scene files";
  const std::string file = std::string(BROMWICH_EXAMPLES) + "/bottlenecks-hard.toml";
  const Json json = study("tol " + file);
  ASSERT_EQ(json["rows"].size(), 3u);
  for (const Json& row : json["rows"]) {
    EXPECT_EQ(row["of"], "mean of y") << row;
    EXPECT_EQ(row["method"], "events");
    EXPECT_EQ(row["reference"], "") << "no grid is as accurate";
  }
}

TEST_F(Bench, SparseSolvesAllItsRows) {
  const Json json = study("sparse");
  ASSERT_EQ(json["rows"].size(), 3u);
  for (const Json& row : json["rows"]) EXPECT_EQ(row["status"], "solved") << row;
  // Two discretisations of second order or more, 1000 steps, y of size 1 to 10.
  EXPECT_LT(json["rows"][0]["difference_max"], 0.1);
}

TEST_F(Bench, SparseShiftsAgree) {
  const Json json = study("sparse-shifts");
  ASSERT_EQ(json["rows"].size(), 1u);
  EXPECT_EQ(json["rows"][0]["states"], 400);
  // Elimination of diagonally dominant matrices, by one thread and by all: rounding of 400 unknowns.
  EXPECT_LT(json["rows"][0]["apart"], 1e-12);
}

TEST_F(Bench, LiteralReachesTheErrorOfMarching) {
  const Json json = study("literal");  // of each backend
  ASSERT_EQ(json["rows"].size() % 4, 0u);
  ASSERT_FALSE(json["rows"].empty());
  double marched = NAN;
  for (const Json& row : json["rows"]) {
    EXPECT_EQ(row["status"], "solved") << row;
    EXPECT_EQ(row["literal_nodes"].is_null(), row["method"] != "contour-literal") << row;
    if (row["method"] == "march") marched = row["error_max"];
    // Sweeps end at a change of min(h, dx^2)/50 = 8e-5; the contours with P = 25 err by less (2.8).
    EXPECT_NEAR(double(row["error_max"]), marched, 3e-4) << row;
  }
}

TEST_F(Bench, FieldsCompareAtEqualError) {
  const Json json = study("fields");
  ASSERT_EQ(json["rows"].size(), 8u);
  std::map<std::string, double> steps;
  for (const Json& row : json["rows"]) {
    EXPECT_EQ(row["status"], "solved") << row;
    // The Euler of the study and method euler solve the same equations; problems of a condition below 1e4.
    EXPECT_LE(row["difference_from_euler"], 1e-9) << row;
    const std::string key = row["at"].get<std::string>() + row["contestant"].get<std::string>();
    steps[key] = std::max(steps[key], row["steps"].get<double>());
    if (row["at"] != "equal error") continue;
    EXPECT_LE(row["error_w_max"], 2e-2) << row;
    EXPECT_LE(row["error_y_mean"], 2e-2) << row;
  }
  EXPECT_LT(steps["equal errormarch"], steps["equal errorsparse euler"]) << "order two against order one";
}

TEST_F(Bench, DualContractsAndAgreesWithImplicitEuler) {
  const Json json = study("dual");
  ASSERT_GE(json["rows"].size(), 2u);
  for (const Json& row : json["rows"]) {
    if (row.contains("put")) {
      // A quick run has few steps: errors are some percent, and what is not solved says so.
      if (row["status"] == "solved") {
        EXPECT_LE(row["error"], 0.05 * row["reference"].get<double>()) << row;
      } else {
        EXPECT_NE(row["method_asked"], "auto") << row;
      }
      continue;
    }
    EXPECT_EQ(row["status"], "solved") << row;
    if (row.contains("equal_error")) continue;
    // A device may leave too few cycles to measure a ratio, and 64 steps too few grids for the estimates.
    if (row["contraction"]["mean"].is_number()) {
      EXPECT_LE(row["contraction"]["mean"], row["rule"] == "euler" ? 0.2 : 0.3) << row;
      if (row["forecast"].is_number()) {
        EXPECT_LE(row["contraction"]["mean"], 1.5 * row["forecast"].get<double>()) << row;
      }
    }
    if (row["backend"] == "cpu") {
      EXPECT_LE(row["useful"]["sweeps"], 20) << row;
    }
    // w to 1e-12 relative to 1, V_0 below 1e2.
    if (row["backend"] == "cpu" && row["rule"] == "euler") {
      EXPECT_LE(row["difference_from_euler"], 2e-10) << row;
    }
  }
}

TEST_F(Bench, MultigridContractsAndStopsInTime) {
  const Json json = study("multigrid");
  ASSERT_GE(json["rows"].size(), 2u);
  for (const Json& row : json["rows"]) {
    EXPECT_EQ(row["status"], "solved") << row;
    EXPECT_LE(row["contraction"], 0.1) << row;
    const Json& useful = row["useful"];
    EXPECT_LE(useful["algebraic_error"], 0.1 * useful["discretisation_error"].get<double>()) << row;
    EXPECT_LT(useful["cycles"], row["cycles"]) << row;
    EXPECT_GT(row["plain_sweeps"], row["sweeps"]) << row;
  }
}

TEST_F(Bench, GalerkinFindsItsOrders) {
  const Json json = study("galerkin");
  std::map<std::string, std::map<std::string, double>> orders;
  for (const Json& row : json["rows"]) {
    const std::string part = row["part"];
    if (part == "order" && row["method"] == "galerkin" && row["scene"] == "bridge")
      for (const auto& [norm, order] : row["order"].items())
        if (!order.is_null()) orders[row["grid"]][norm] = order;  // null: exact on every grid
    if (part == "convergence" && row["method"] == "galerkin") {
      EXPECT_TRUE(row["solved"]) << row;
    }
    // The best piecewise-linear y is closer than the continuous one, which is closer than the constant one.
    if (part == "projection") {
      EXPECT_LE(row["discontinuous"], row["continuous"]) << row;
      EXPECT_LT(row["continuous"], row["constant"]) << row;
    }
    if (part == "ratio") {
      EXPECT_GT(row["x_at_T"], 100) << row;  // 49 h = 1 here; 2000 at h = 1e-3
    }
    if (part == "cost") {
      EXPECT_EQ(row["status"], "solved") << row;
    }
    if (part == "periodic") {
      EXPECT_LE(row["boundary_residual"], 1e-12) << row;
    }
    if (part == "periodic" && row["steps"] == 6400) {
      EXPECT_LE(row["difference"], 1e-5) << row;
    }
    // Monotone, with 0.1 from M + 0.1 I alone; the matrix that the paper prints makes it indefinite at T = 1.
    if (part == "eigenvalue" && row["scene"] == "nash-game" && !row["as_printed"]) {
      EXPECT_NEAR(row["smallest"], 0.1, 1e-6) << row;
    }
    if (part == "eigenvalue" && row["as_printed"] && row["T"] == 1.0) {
      EXPECT_LT(row["smallest"], -0.1) << row;
    }
  }
  ASSERT_TRUE(orders["kinks on nodes"].contains("x_at_T"));
  for (const auto& [norm, order] : orders["kinks on nodes"]) EXPECT_GE(order, 1.9) << norm;
  EXPECT_GE(orders["kinks off nodes"]["y_L2"], 1.4);
}

TEST_F(Bench, PaperFindsWhatItsFiguresShow) {
  const Json json = study("paper");
  std::map<std::string, int> figures;
  for (const Json& row : json["rows"]) ++figures[row["figure"]];
  for (const char* figure : {"4.1", "4.3 left", "4.3 right", "4.4", "4.6 left", "4.6 right"})
    EXPECT_GT(figures[figure], 0) << figure;
  for (const Json& row : json["rows"])
    if (row["figure"] == "4.6 right") {
      EXPECT_GT(row["sweeps_to_1e-12"], row["sweeps_to_tolerance"]) << row;
    }
}

TEST_F(Bench, SpeedVsErrorRefusesWhatHasNoScene) {
  EXPECT_TRUE(contains(refused("bench speed-vs-error --steps 64").err, "SCENE"));
  EXPECT_TRUE(contains(refused("bench speed-vs-error --set Q=7").err, "SCENE"));
}

TEST_F(Bench, GoalComparesGridsOfTheSameSteps) {
  const Json json = study("goal --steps 100");
  EXPECT_EQ(json["bench"], "goal");
  std::map<std::string, Json> toy;
  for (const Json& row : json["rows"]) {
    EXPECT_EQ(row["steps"], 100) << row;
    for (const char* key : {"I_loc", "I_glob", "violation", "violation_right", "violation_linear", "error_x"})
      EXPECT_TRUE(row[key].is_number()) << key << row;
    if (row["scene"] == "ph-toy") toy[row["contestant"]] = row;
  }
  EXPECT_LT(toy["euler, goal"]["I_loc"], toy["euler, uniform"]["I_loc"]);
  EXPECT_EQ(toy["euler, goal"]["I_loc"], toy["euler, goal, doubling"]["I_loc"]);
  EXPECT_LT(toy["midpoint, goal"]["I_loc"], toy["midpoint, uniform"]["I_loc"]);
  const Json& gain = json["details"]["equidistribution_gain"];
  EXPECT_NEAR(gain["ph-toy"], 19, 1);
  EXPECT_NEAR(gain["ladder"], 2.2, 0.1);
  const Json& figures = json["details"]["figures"];
  EXPECT_EQ(figures["adjoints"].size(), 3u);
  EXPECT_EQ(figures["toy"].size(), 4u);
  EXPECT_EQ(figures["ladder"].size(), 2u);
}

TEST_F(Bench, StabilityKnowsTheTruthOfEveryCase) {
  const Json json = study("stability");
  std::map<std::string, int> groups;
  for (const Json& row : json["rows"]) {
    ++groups[row["group"]];
    const std::string verdict = row["verdict"];
    // A result that says solved is right; others have a reason.
    EXPECT_NE(verdict, "wrong") << row;
    if (verdict == "refused") {
      EXPECT_NE(row["reason"], "") << row;
    } else
      EXPECT_LE(row["error_x"], 3 * double(row["tolerance"])) << row;
    for (const char* key : {"estimate", "seconds", "euler", "reference", "steps"})
      EXPECT_TRUE(row.contains(key)) << key;
  }
  for (const char* group : {"A", "M", "sources", "starts", "scales", "sizes"}) EXPECT_GE(groups[group], 2) << group;
  // Implicit Euler is of first order and seldom as good: references do not come from the method they judge.
  int compared = 0;
  for (const Json& row : json["rows"])
    if (row["group"] == "A" && row["verdict"] == "right" && row["euler"]["error_x"].is_number() &&
        row["euler"]["status"] == "solved") {
      EXPECT_LT(row["euler"]["error_x"], 0.2) << row;
      ++compared;
    }
  EXPECT_GE(compared, 5);
}

}  // namespace
}  // namespace bromwich
