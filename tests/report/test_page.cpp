#include "report/charts.hpp"
#include "report/page.hpp"
#include "report/page_parts.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <regex>

namespace bromwich::report {
namespace {

bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

/// The vertical positions of the first curve of a picture.
std::vector<double> heights(const std::string& svg) {
  std::smatch path;
  std::vector<double> found;
  if (!std::regex_search(svg, path, std::regex("class=\"line s0\" d=\"([^\"]*)\""))) return found;
  const std::string d = path[1];
  const std::regex point("[ML]([-0-9.]+) ([-0-9.]+)");
  for (std::sregex_iterator i(d.begin(), d.end(), point), end; i != end; ++i) found.push_back(std::stod((*i)[2]));
  return found;
}

Report sample() {
  Report report;
  report.source = "a & b.csv";
  report.version = "1.2.3";
  report.table.t = Vector::LinSpaced(5, 0, 2);
  Quantity y{"y", {"y0", "y1"}, {"", ""}, RowMatrix::Zero(5, 2)};
  y.values.col(0) << 0, 1, 2, 0, 3;
  report.table.quantities.push_back(std::move(y));
  report.summary = Json::parse(R"json({
    "schema": "bromwich/1", "scene": "<scene>", "status": "solved", "reason": "", "warning": "y is not unique",
    "parameters": {"R": 1000, "tau": 1e-6}, "sizes": {"constraints": 2, "states": 3, "T": 2}, "steps": 4,
    "class": "P (H+)", "spectrum": "real", "method": "march", "backend": "cpu", "threads": 1, "kernel": "scan",
    "requested": {"method": "auto", "tolerance": 0.001, "iteration_tolerance": null},
    "decisions": ["auto tries march", "method march: 4 steps"],
    "residual": 2.5e-16, "error_estimate": 4e-4, "history": [1, 0.1, 0.001],
    "errors": {"discretisation": 3.9e-4, "kernel": 1e-14, "iteration": 0, "tolerance": 0.001, "of": "y", "order": 1.9,
               "grids": [4, 8, 16], "estimates": [null, 0.002, 4e-4]},
    "seconds": {"total": 2, "setup": 0.5, "solve": 1.5, "lcp": 0.5, "convolution": 0.25, "transform": 0.25, "other": 0.5,
                "certification": 0.2}, "bytes": 1500000, "bytes_predicted": 2000000})json");
  return report;
}

TEST(Page, SaysInWordsWhatTheSummarySays) {
  const std::string html = page(sample());
  for (const char* words : {"&lt;scene&gt;",
                            "a &amp; b.csv",
                            "bromwich 1.2.3",
                            "solved",
                            "passed all checks",
                            "y is not unique",
                            "R = 1000, tau = 1e−6",
                            "2 constraints, 3 states, 4 time steps up to T = 2",
                            "P (H+)",
                            "march on cpu, 1 thread",
                            "auto tries march<br/>method march: 4 steps",
                            "method auto, error below 0.001",
                            "2.5e−16",
                            "4e−4",
                            "the tolerance is 0.001",
                            "below the tolerance",
                            "order 1.9",
                            "Grids of 4, 8, 16 steps",
                            "1.5 MB",
                            "predicted were 2 MB",
                            "25 %"})
    EXPECT_TRUE(contains(html, words)) << words;
  for (const char* never : {"<script", "<scene>", "nan", "href", "src="}) EXPECT_FALSE(contains(html, never)) << never;
}

/// Widths of the bars of a style.
std::vector<double> widths(const std::string& html, const std::string& style) {
  std::vector<double> found;
  const std::regex bar("<rect class=\"" + style + "\" x=\"[-0-9.]+\" y=\"[-0-9.]+\" width=\"([-0-9.]+)\"");
  for (std::sregex_iterator i(html.begin(), html.end(), bar), end; i != end; ++i) found.push_back(std::stod((*i)[1]));
  return found;
}

TEST(Page, ContactsOfAStructure) {
  Report report = sample();
  EXPECT_EQ(contacts_part(report), "");
  report.summary.update(Json::parse(R"json({"coordinates": 1, "contacts": {"<floor>": {
    "stick": 0.5, "slip": 1, "open": 0.5, "normal_impulse": 7.25, "largest_normal": 3, "friction_loss": 0.125,
    "impact_loss": 0.0625, "phases": [{"begin": 0, "end": 0.5, "state": "stick"}, {"begin": 0.5, "end": 1, "state": "open"},
    {"begin": 1, "end": 2, "state": "slip"}], "impacts": [{"t": 1}]}},
    "energy": {"located": true, "initial": 1, "supplied": 2, "stored": 2.5, "damping": 0.25, "friction": 0.125,
               "impacts": 0.125, "error": 3e-12}})json"));
  report.table.quantities.push_back(
      {"x", {"q0", "v_q0"}, {"", ""}, RowMatrix{{0, 1}, {1, 0}, {0, -1}, {-1, 0}, {0, 1}}});
  const std::string html = contacts_part(report);
  ASSERT_EQ(widths(html, "bar").size(), 1u);
  ASSERT_EQ(widths(html, "bar light").size(), 1u);
  EXPECT_NEAR(widths(html, "bar light")[0], 2 * widths(html, "bar")[0], 0.2);  // 1 and 0.5, to 0.1 units of the picture
  for (const char* words :
       {"&lt;floor&gt;", "7.25", "0.0625", "class=\"tick\"", "Phase plane", "q0 in the phase plane"})
    EXPECT_TRUE(contains(html, words)) << words;
  EXPECT_EQ(heights(html).size(), 5u);
  EXPECT_TRUE(contains(certificate_part(report), "balance of energy"));
  EXPECT_TRUE(contains(certificate_part(report), "3e−12"));
}

TEST(Page, PartsOfTheTimeAddUp) {
  const std::string html = time_part(sample());
  // 760 units less two margins of 4: set-up takes a quarter.
  EXPECT_TRUE(contains(html, R"(<rect class="part part-0" x="4.0" y="4" width="188.0")")) << html;
  EXPECT_TRUE(contains(html, "0.2 s"));
  EXPECT_TRUE(contains(html, "0.3 s"));  // other, without the certification
  EXPECT_EQ(time_part(Report{}), "");
}

TEST(Page, WorksWithoutASummary) {
  Report report = sample();
  report.summary = nullptr;
  report.table.remark = "ended at t = 2: infeasible";
  const std::string html = page(report);
  EXPECT_TRUE(contains(html, "no summary"));
  EXPECT_TRUE(contains(html, "ended at t = 2: infeasible"));
  EXPECT_TRUE(contains(html, "5 rows, 2 columns"));
  EXPECT_TRUE(contains(html, "Active constraints"));
}

TEST(Page, StatusesHaveTheirWords) {
  const auto words = [](const std::string& status, const char* reason, Json at = nullptr) {
    return status_sentence({{"status", status}, {"reason", reason}, {"infeasible_at", at}});
  };
  EXPECT_TRUE(
      contains(words("infeasible", "no solution from t = 0.5 on", 0.5), "from t = 0.5 on; the curves end there"));
  EXPECT_TRUE(contains(words("tolerance_not_met", "the residual is 1"), "The residual is 1.") ||
              contains(words("tolerance_not_met", "the residual is 1"), "the residual is 1."));
  for (const char* status : {"unsupported", "nonfinite", "interrupted", "tolerance_not_met"})
    EXPECT_TRUE(contains(words(status, "a reason"), "Reason: a reason.")) << status;
  EXPECT_TRUE(contains(status_sentence(nullptr), "not known"));
}

TEST(Page, ImpulsesAtTheStartAreLeftOut) {
  Report report = sample();
  for (const char* symbol : {"y", "w"}) {
    report.table.quantities[0].symbol = symbol;
    report.table.quantities[0].values(0, 0) = 1e9;
    report.summary["starts_with_impulse"] = false;
    EXPECT_TRUE(contains(curves_part(report), "1e9")) << symbol;
    report.summary["starts_with_impulse"] = true;
    EXPECT_FALSE(contains(curves_part(report), "1e9")) << symbol;
    EXPECT_TRUE(contains(curves_part(report), "impulse")) << symbol;
  }
}

TEST(ActiveTimes, AreRunsOfPositiveRows) {
  const Vector t{{0, 1, 2, 3, 4, 5}}, y{{0, 1, 1e-20, 2, 3, 0}};
  const std::vector<std::pair<double, double>> expected{{1, 1}, {3, 4}};
  EXPECT_EQ(active_times(t, y, 1e-12), expected);
  EXPECT_TRUE(active_times(t, Vector::Constant(6, NAN), 0).empty());
  EXPECT_EQ(active_times(t, Vector::Ones(6), 0).size(), 1u);
}

// The positions of a curve are the affine image of its values.
TEST(LineChart, DrawsTheValues) {
  Vector y(4);
  y << 0, 4, 1, 8;
  const std::string svg =
      line_chart({"title", {"time t"}, {"y"}, {{"y0", Vector::LinSpaced(4, 0, 3), y, false, false}}, {}});
  const std::vector<double> h = heights(svg);
  ASSERT_EQ(h.size(), 4u);
  const double unit = (h[0] - h[3]) / 8;  // pixels per value; positions are rounded to 0.1
  EXPECT_GT(unit, 20);
  EXPECT_NEAR(h[1], h[0] - 4 * unit, 0.11);
  EXPECT_NEAR(h[2], h[0] - 1 * unit, 0.11);
  EXPECT_TRUE(contains(svg, ">time t</text>"));
  EXPECT_TRUE(contains(svg, "<title>title</title>"));
}

TEST(LineChart, StepsAndGaps) {
  Vector y(4);
  y << 0, 1, NAN, 2;
  const LineChart chart{"", {"t"}, {"y"}, {{"y0", Vector::LinSpaced(4, 0, 3), y, true, false}}, {}};
  EXPECT_EQ(heights(line_chart(chart)).size(), 4u);  // one step has two points, behind the gap one
  LineChart decades{
      "", {"k"}, {"y", true}, {{"y0", Vector::LinSpaced(4, 1, 4), y, false, true}}, {{1e-3, "tolerance"}}};
  const std::string svg = line_chart(decades);
  EXPECT_EQ(heights(svg).size(), 2u);  // 0 has no place on a logarithmic axis
  EXPECT_TRUE(contains(svg, "tolerance"));
}

TEST(LineChart, ManyRowsStaySmallAndKeepASpike) {
  const Index rows = 200001;
  Vector y = Vector::Zero(rows);
  y[123456] = 5;
  const std::string svg = line_chart({"", {"t"}, {"y"}, {{"y0", Vector::LinSpaced(rows, 0, 1), y, false, false}}, {}});
  EXPECT_LT(svg.size(), 60000u);
  const std::vector<double> h = heights(svg);
  EXPECT_GT(*std::max_element(h.begin(), h.end()) - *std::min_element(h.begin(), h.end()), 200);  // of 230
}

TEST(HeatMap, ShowsASpikeOfOneRow) {
  const Index rows = 20001;
  HeatMap map{"", "t", "constraint", "y", Vector::LinSpaced(rows, 0, 1), RowMatrix::Zero(rows, 200), false};
  map.values(7777, 123) = 1;
  const std::string svg = heat_map(map);
  EXPECT_TRUE(contains(svg, "stroke=\"#fde725\""));  // the brightest, of a single cell
  EXPECT_TRUE(contains(svg, "h1\"/>"));
  EXPECT_LT(svg.size(), 20000u);
}

TEST(NumberBars, ShowNumbersAndTheLevel) {
  const std::string svg = number_bars({"", "error", {{"steps", 1e-5}, {"kernel", 2e-13}}, {{1e-4, "tolerance 1e−4"}}});
  for (const char* words : {"1e−5", "2e−13", "tolerance 1e−4", "steps", "kernel"}) EXPECT_TRUE(contains(svg, words));
}

}  // namespace
}  // namespace bromwich::report
