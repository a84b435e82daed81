// `bromwich plot`: a page from files that `solve` has written.

#include "app/commands.hpp"
#include "app/output_file.hpp"
#include "app/text.hpp"
#include "core/base/error.hpp"
#include "core/build_info.hpp"
#include "files/number_files.hpp"
#include "report/page.hpp"
#include "report/response_page.hpp"
#include "report/sweep_page.hpp"

#include <fmt/format.h>

#include <filesystem>

namespace bromwich::app {

namespace {

namespace fs = std::filesystem;

std::string result_name(const PlotArguments& arguments) {
  if (arguments.results.empty())
    throw Error("RESULT", "found none", "name a file that 'bromwich solve SCENE --out FILE' has written");
  if (arguments.results.size() > 1) throw Error("RESULT", "found " + join(arguments.results), "name one file");
  return arguments.results.front();
}

report::Json read_summary(const std::string& name) {
  const std::string text = read_text({name, name}, "--summary");
  report::Json summary = report::Json::parse(text, nullptr, false);
  if (summary.is_discarded() || !summary.is_object())
    throw Error("--summary", fmt::format("'{}' is not a JSON object", name),
                "give a file that 'bromwich solve SCENE --json' has printed");
  if (const std::string schema = report::text_at(summary, "schema"); schema != "bromwich/1")
    throw Error("--summary", fmt::format("'{}' has the schema '{}'", name, one_line(schema)),
                "give a file that 'bromwich solve SCENE --json' has printed, of schema 'bromwich/1'");
  return summary;
}

}  // namespace

int run_plot(const PlotArguments& arguments) {
  const std::string name = result_name(arguments);
  const std::string target = arguments.out.empty() ? fs::path(name).replace_extension(".html").string() : arguments.out;
  const OutputFile file("--out", target, ".html");
  const std::string title = fs::path(name).filename().string();
  const auto finish = [&](const std::string& page) {
    file.write([&page](std::FILE* out) { std::fwrite(page.data(), 1, page.size(), out); });
    print(fmt::format("{}\n", target));
    return exit_solved;
  };
  if (const auto sweep = report::read_sweep_table("RESULT", name))
    return finish(report::sweep_page(*sweep, title, build_info::version));
  if (const auto curves = report::read_response_table("RESULT", name))
    return finish(report::response_page(*curves, title, build_info::version));
  report::Json summary = arguments.summary.empty() ? report::Json() : read_summary(arguments.summary);
  const Index constraints = summary.contains("sizes") ? summary["sizes"].value("constraints", Index(-1)) : Index(-1);
  report::ResultTable table = report::read_result("RESULT", name, constraints);
  if (arguments.summary.empty() && !table.summary.empty()) summary = report::Json::parse(table.summary, nullptr, false);
  report::Report made{std::move(summary), std::move(table), title, build_info::version};
  return finish(report::page(made));
}

}  // namespace bromwich::app
