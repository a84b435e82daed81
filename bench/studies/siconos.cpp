#include "bench/studies/siconos.hpp"

#include "app/output_json.hpp"
#include "core/base/error.hpp"
#include "core/dynamics/dense.hpp"
#include "core/dynamics/sparse.hpp"
#include "core/lcp/matrix.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>

namespace bromwich::app {

namespace {

constexpr int most_seconds_of_siconos = 60;
constexpr double most_numbers = 5e7;      ///< of the sources in the file
constexpr Index most_dense_states = 200;  ///< its sparse matrices are slower below

/// Removed with its files at the end of the scope.
class TemporaryFolder {
 public:
  TemporaryFolder() : path_(std::filesystem::temp_directory_path() / "bromwich-siconos-XXXXXX") {
    std::string name = path_.string();
    if (!mkdtemp(name.data()))
      throw Error("--siconos", "no temporary folder could be made", "check the folder that TMPDIR names");
    path_ = name;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  std::filesystem::path operator/(const char* name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

SparseDynamics as_sparse(const Dynamics& dynamics) {
  if (const auto* sparse = get_if<SparseDynamics>(&dynamics)) return *sparse;
  const auto& dense = get<DenseDynamics>(dynamics);
  return {dense.A.sparseView(), dense.B.sparseView(), dense.N.sparseView()};
}

class ProblemFile {
 public:
  explicit ProblemFile(const std::filesystem::path& path) : file_(path, std::ios::binary) {}

  void number(double value) { file_.write(reinterpret_cast<const char*>(&value), sizeof value); }
  void values(const RowMatrix& rows) {
    file_.write(reinterpret_cast<const char*>(rows.data()), std::streamsize(sizeof(double)) * rows.size());
  }
  void close() {
    file_.close();
    if (!file_) throw Error("--siconos", "the problem could not be written", "make room in the temporary folder");
  }

 private:
  std::ofstream file_;
};

// The layout is that of bench/peers/siconos_loop.cpp.
void write_problem(const std::filesystem::path& path, const Scene& scene, const std::vector<Index>& components,
                   Index J) {
  const SparseDynamics d = as_sparse(scene.dynamics);
  const Index m = scene.states(), n = scene.constraints();
  ProblemFile file(path);
  for (const Index size : {m, n, Index(d.A.nonZeros()), J, Index(components.size())}) file.number(double(size));
  file.number(scene.T / double(J));
  for (Index k = 0; k < d.A.outerSize(); ++k)
    for (SparseMatrix::InnerIterator a(d.A, k); a; ++a)
      for (const double entry : {double(a.row()), double(a.col()), a.value()}) file.number(entry);
  for (const RowMatrix& part : {RowMatrix(d.B), RowMatrix(d.N), RowMatrix(to_dense(scene.M))}) file.values(part);
  file.values(scene.x0.transpose());
  file.values(RowMatrix::Zero(1, m));  // theta = 1 does not use r before the first step
  for (const Index i : components) file.number(double(i));

  Vector phi(scene.sources()), f = Vector::Zero(m), g = Vector::Zero(n);
  for (Index j = 1; j <= J; ++j) {
    if (scene.f) scene.f(scene.T * double(j) / double(J), phi);
    if (scene.f && scene.f_entry == SourceEntry::state) f = phi;
    if (scene.f && scene.f_entry == SourceEntry::through_B) f = d.B * phi;
    if (scene.f && scene.f_entry == SourceEntry::through_F) f = scene.F * phi;
    file.values(f.transpose());
  }
  for (Index j = 1; j <= J; ++j) {
    if (scene.g) scene.g(scene.T * double(j) / double(J), g);
    file.values(g.transpose());
  }
  file.close();
}

std::string output_of(const std::string& command) {
  std::string text;
  std::FILE* pipe = popen(command.c_str(), "r");
  if (!pipe) return text;
  std::array<char, 4096> part;
  while (const std::size_t size = std::fread(part.data(), 1, part.size(), pipe)) text.append(part.data(), size);
  pclose(pipe);
  return text;
}

/// The last line in braces; null without one.
Json last_line(const std::string& text) {
  const std::size_t begin = text.rfind("{\"setup\"");
  return begin == std::string::npos ? Json() : Json::parse(text.substr(begin), nullptr, false);
}

RowMatrix read_rows(const std::filesystem::path& path, Index rows, Index columns) {
  RowMatrix values = RowMatrix::Constant(rows, columns, NAN);
  std::ifstream(path, std::ios::binary)
      .read(reinterpret_cast<char*>(values.data()), std::streamsize(sizeof(double)) * values.size());
  return values;
}

}  // namespace

bool fits_siconos(const Scene& scene) {
  const bool plain = scene.x0.size() > 0 && scene.free_rows.empty() && scene.constraints() > 0;
  if (!plain) return false;
  if (const auto* dense = get_if<DenseDynamics>(&scene.dynamics)) return dense->E.size() == 0;
  const auto* sparse = get_if<SparseDynamics>(&scene.dynamics);
  return sparse && sparse->E.size() == 0 && to_dense(scene.M).size() > 0;
}

Result siconos_euler(const std::string& program, const Scene& scene, const std::vector<Index>& components, Index J) {
  const Index m = scene.states(), n = scene.constraints();
  Result r;
  r.method = Method::euler;
  r.steps = J;
  r.status = Status::nonfinite;
  r.reason = "not run: the sources are too large for its file";
  r.seconds.total = r.seconds.setup = r.seconds.solve = NAN;
  if (double(J) * double(m + n) > most_numbers) return r;
  r.x_components = components;
  for (Index i = 0; components.empty() && i < m; ++i) r.x_components.push_back(i);

  const TemporaryFolder folder;
  const auto problem = folder / "problem", rows = folder / "rows";
  write_problem(problem, scene, r.x_components, J);
  const Json line =
      last_line(output_of(fmt::format("timeout {} '{}' '{}' '{}' {} once 1 2>&1", most_seconds_of_siconos, program,
                                      problem.string(), rows.string(), m > most_dense_states ? "sparse" : "dense")));
  r.reason = fmt::format("the process failed or took longer than {} s", most_seconds_of_siconos);
  if (!line.is_object()) return r;

  const RowMatrix found = read_rows(rows, J, n + Index(r.x_components.size()));
  r.t = Vector::LinSpaced(J + 1, 0, scene.T);
  r.y = RowMatrix::Constant(J + 1, n, NAN);
  r.x.resize(J + 1, found.cols() - n);
  r.y.bottomRows(J) = found.leftCols(n);
  r.x.row(0) = scene.x0(r.x_components).transpose();
  r.x.bottomRows(J) = found.rightCols(found.cols() - n);
  const Index failures = line.value("failures", Index(0));
  r.status = !found.allFinite() ? Status::nonfinite : failures > 0 ? Status::tolerance_not_met : Status::solved;
  r.reason = failures > 0 ? fmt::format("{} of its LCPs failed", failures) : "";
  r.seconds.setup = line.value("setup", NAN);
  r.seconds.solve = line.value("loop", NAN);
  r.seconds.total = r.seconds.setup + r.seconds.solve;
  return r;
}

}  // namespace bromwich::app
