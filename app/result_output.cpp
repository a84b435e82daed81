#include "app/result_output.hpp"

#include "app/ranks.hpp"
#include "core/base/error.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/result/slack.hpp"
#include "core/scene/component_names.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <functional>
#include <utility>

namespace bromwich::app {

namespace fs = std::filesystem;

namespace {

const std::vector<std::pair<std::string, ResultFormat>> formats{{".csv", ResultFormat::csv},
                                                                {".h5", ResultFormat::hdf5},
                                                                {".hdf5", ResultFormat::hdf5},
                                                                {".npz", ResultFormat::npz},
                                                                {".vtkhdf", ResultFormat::vtkhdf}};
constexpr const char* extensions = ".csv, .h5, .npz or .vtkhdf";

std::string lower_extension(const std::string& name) {
  std::string found = fs::path(name).extension();
  for (char& c : found) c = char(std::tolower(static_cast<unsigned char>(c)));
  return found;
}

const std::pair<std::string, ResultFormat>& format_of(const std::string& argument, const std::string& name) {
  const std::string found = lower_extension(name);
  for (const auto& format : formats)
    if (format.first == found) return format;
  const bool option = name.empty() || name[0] == '-';
  throw Error(argument, fmt::format("'{}' {}", name, option ? "is not a file name" : "is of no known format"),
              fmt::format("give a file name that ends in {}", extensions));
}

void require_library(const std::string& argument, const std::string& name, ResultFormat format) {
  if (format == ResultFormat::hdf5 || format == ResultFormat::vtkhdf) require_hdf5({argument, name});
  if (format != ResultFormat::npz || npz_available()) return;
  throw Error(argument, fmt::format("'{}' needs minizip, which this build does not have", name),
              "write a file .csv, or use Result.save of Python; a build with libminizip-dev has it");
}

/// The unit of all columns; empty where they differ, since an array of a file has one.
std::string common(const std::vector<std::string>& units) {
  const bool same = std::adjacent_find(units.begin(), units.end(), std::not_equal_to<>()) == units.end();
  return units.empty() || !same ? "" : units.front();
}

bool any_finite(const RowMatrix& values, Index j) {
  return j < values.rows() && values.row(j).array().isFinite().any();
}

}  // namespace

ResultFormat result_format(const std::string& argument, const std::string& name) {
  return format_of(argument, name).second;
}

Index valid_rows(const Result& result) {
  Index rows = result.t.size();
  if (result.status == Status::solved) return rows;
  while (rows > 0 && !any_finite(result.y, rows - 1) && !any_finite(result.x, rows - 1)) --rows;
  return rows;
}

std::optional<FieldGrid> field_grid(const Scene& scene, const std::optional<Rectangle>& rectangle) {
  if (rectangle && rectangle->beside.empty()) {
    const auto first = [](const GridLine& line) { return line.first ? line.spacing / 2 : line.spacing; };
    const GridLine &along = rectangle->along, &across = rectangle->across;
    return FieldGrid{along.points, across.points, along.spacing, across.spacing, first(along), first(across)};
  }
  const auto* sum = get_if<KroneckerDynamics>(&scene.dynamics);
  if (!sum || !sum->beside.empty()) return std::nullopt;
  return FieldGrid{sum->along.points, sum->across.points, sum->along.spacing, sum->across.spacing};
}

ResultOutput::ResultOutput(const std::string& argument, const std::string& name, const Scene& scene,
                           const std::optional<Rectangle>& rectangle)
    : argument_(argument),
      format_(format_of(argument, name).second),
      file_(argument, name, format_of(argument, name).first),
      scene_(scene),
      rectangle_(rectangle) {
  require_library(argument, name, format_);
  if (format_ == ResultFormat::vtkhdf) grid();
}

FieldGrid ResultOutput::grid() const {
  if (const auto found = field_grid(scene_, rectangle_)) return *found;
  throw Error(argument_,
              fmt::format("'{}' is for fields on a grid of a rectangle, which the scene does not have", name()),
              "write a file .h5 or .csv");
}

ResultOutput::~ResultOutput() {
  if (!growing_ || finished_) return;
  try {
    growing_->set({{"status", "failed"}});
  } catch (const Error&) {  // the reason of the failure may be that nothing can be written
  }
}

void ResultOutput::check_states(const std::vector<Index>& states) const {
  if (format_ == ResultFormat::vtkhdf && !states.empty() && Index(states.size()) != scene_.states())
    throw Error(argument_, fmt::format("'{}' holds x of all points or of none", name()),
                "add --states all or --states none");
}

ResultColumns ResultOutput::columns(const std::vector<Index>& states) const {
  ResultColumns columns;
  columns.constraints = scene_.constraints();
  columns.slack = with_slack();
  columns.states = states;
  for (Index i = 0; i < columns.constraints; ++i) columns.constraint_names.push_back(multiplier_name(scene_, i));
  std::vector<std::string> units_of_states;
  for (const Index i : states) {
    columns.state_names.push_back(state_name(scene_, i));
    units_of_states.push_back(std::size_t(i) < scene_.units.x.size() ? scene_.units.x[std::size_t(i)] : "");
  }
  columns.t_unit = scene_.time_unit;
  columns.y_unit = common(scene_.units.y);
  columns.w_unit = common(scene_.units.w);
  columns.x_unit = common(units_of_states);
  return columns;
}

bool ResultOutput::exists() const {
  std::error_code none;
  return fs::exists(file_.target(), none);
}

void ResultOutput::begin(const std::vector<Index>& states, Index rows, Facts facts) {
  states_ = states;
  facts_ = facts;
  if (!grows() || !first_rank()) return;
  facts.emplace_back("status", "running");
  const FileTarget target{argument_, file_.target()};
  growing_ = format_ == ResultFormat::hdf5 ? create_hdf5(target, columns(states), rows, facts)
                                           : create_vtkhdf(target, grid(), columns(states), rows, facts);
}

void ResultOutput::resume(const std::vector<Index>& states, Index rows, const std::string& run) {
  states_ = states;
  if (!first_rank()) return;
  const FileTarget target{argument_, file_.target()};
  growing_ = format_ == ResultFormat::hdf5 ? continue_hdf5(target, columns(states), rows, run)
                                           : continue_vtkhdf(target, grid(), columns(states), rows, run);
  growing_->set({{"status", "running"}});
}

void ResultOutput::append(const Scene& part, const Result& result, const Vector& t, Index first, Index last) {
  if (!growing_ || last < first) return;
  // In blocks: what is written is not held twice.
  const Index width = std::max<Index>(scene_.constraints(), Index(states_.size()));
  const Index step = std::max<Index>(1, (1 << 21) / std::max<Index>(1, width));
  const bool all = Index(states_.size()) == Index(result.x_components.size());
  for (Index begin = first; begin <= last; begin += step) {
    const Index count = std::min(step, last + 1 - begin);
    RowMatrix w = RowMatrix::Constant(count, scene_.constraints(), std::nan("")), x;
    if (result.trace.rows() == result.t.size()) w = slack(part, result, begin, count);
    if (!all) x = result.x.middleRows(begin, count)(Eigen::all, states_);
    using View = Eigen::Ref<const RowMatrix>;
    growing_->append({t.segment(begin - first, count), result.y.middleRows(begin, count), w,
                      all ? View(result.x.middleRows(begin, count)) : View(x)});
  }
}

void ResultOutput::flush() {
  if (growing_) growing_->flush();
}

void ResultOutput::write(const Result& sampled, const Result& result, const std::vector<Column>& columns_of_csv,
                         const std::vector<TimeSeries>& contacts, const Energies* energies, const Facts& facts) {
  if (format_ == ResultFormat::csv) {
    file_.write([&](std::FILE* file) { write_csv(scene_, sampled, result, columns_of_csv, file, contacts, energies); });
    return;
  }
  Index rows = sampled.t.size();
  if (result.status != Status::solved) {
    while (rows > 0 && !any_finite(sampled.y, rows - 1) && !any_finite(sampled.x, rows - 1)) --rows;
  }
  std::vector<TimeSeries> series = energies ? energy_series(*energies) : mode_series(scene_, sampled);
  series.insert(series.end(), contacts.begin(), contacts.end());
  for (TimeSeries& one : series) one.values.conservativeResize(rows);
  if (grows()) {
    append(scene_, sampled, sampled.t.head(rows), 0, rows - 1);
    if (growing_ && !series.empty()) growing_->add(series);
    finish(facts);
    return;
  }
  ResultColumns wanted = columns(sampled.x_components);
  wanted.slack = sampled.trace.rows() == sampled.t.size();
  RowMatrix w;
  if (wanted.slack && rows > 0) w = slack(scene_, sampled, 0, rows);
  const RowMatrix missing(0, 0);
  using View = Eigen::Ref<const RowMatrix>;
  const bool has_y = sampled.y.rows() >= rows && sampled.y.cols() == scene_.constraints();
  if (!has_y) wanted.constraints = 0;
  const View y = has_y ? View(sampled.y.topRows(rows)) : View(missing);
  const View x = sampled.x.rows() >= rows ? View(sampled.x.topRows(rows)) : View(missing);
  const FileTarget target{argument_, file_.target()};
  Facts all = facts_;
  all.insert(all.end(), facts.begin(), facts.end());
  file_.write([&](std::FILE* file) { write_npz(target, wanted, {sampled.t.head(rows), y, w, x}, series, all, file); });
}

void ResultOutput::finish(const Facts& facts) {
  if (!growing_) return;
  growing_->set(facts);
  finished_ = true;
}

}  // namespace bromwich::app
