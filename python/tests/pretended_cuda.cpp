// A shared object in the place of bromwich/_cuda.so: its two devices are backends of naive loops. Shows on machines
// without a device that backends, plans and errors pass between two shared objects. The number of threads chooses what
// they do. With three threads they fail, and the error names the device. With two they report expensive single steps,
// as devices do. With four threads their arrays are not in reach of the host, and have operations on rows. With five
// threads they have arrays and steps of many scenes alone, and a line for each copy between them and the host goes to
// the file that BROMWICH_PRETENDED_COPIES names. Otherwise they are like a processor.

#include "core/base/error.hpp"
#include "core/seam/scene_arrays.hpp"
#include "core/seam/shared_memory.hpp"
#include "kernels/cuda_plugin.hpp"
#include "tests/support/reference_backend.hpp"
#include "tests/support/row_ranks.hpp"

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <string>

namespace bromwich {

namespace {

class CountedArray final : public Array {
 public:
  explicit CountedArray(RowMatrix&& made) : Array(made.rows(), made.cols(), made.data()), values(std::move(made)) {}
  RowMatrix values;
};

class CountedBackend final : public Backend, public SharedMemory {
 public:
  CountedBackend() : Backend("counted") {
    // There, so that batches are differentiated in its arrays, which takes the steps of the host.
    fused_.scene_arrays = [](const SceneArraysProblem&, Index) { return nullptr; };
  }
  DeviceInfo device() const override { return {"counted", 1, ""}; }
  std::unique_ptr<Array> array(Index rows, Index cols) override {
    return std::make_unique<CountedArray>(RowMatrix::Zero(rows, cols));
  }
  void upload(const RowMatrix& from, Array& to) override {
    count("to", from.rows(), from.cols());
    values(to).topRows(from.rows()) = from;
  }
  void download(const Array& from, RowMatrix& to) override {
    count("from", from.rows(), from.cols());
    to = static_cast<const CountedArray&>(from).values;
  }
  Place place() const override { return {}; }
  std::shared_ptr<double> numbers(Index size) override {
    return {new double[std::size_t(size)], std::default_delete<double[]>()};
  }
  void read(const double* from, Array& to) override {
    values(to) = Eigen::Map<const RowMatrix>(from, to.rows(), to.cols());
  }
  void write(const Array& from, double* to) override {
    Eigen::Map<RowMatrix>(to, from.rows(), from.cols()) = static_cast<const CountedArray&>(from).values;
  }
  void to_host(const void* from, std::size_t bytes, void* to) override {
    count("from", Index(bytes / sizeof(double)), 1);
    std::memcpy(to, from, bytes);
  }
  void add_product(const LcpMatrix&, const Array&, Array&) override { refuse(); }
  void inject(const Array&, Array&) override { refuse(); }
  void interpolate(const Array&, const Array*, Array&) override { refuse(); }
  void add(const Array&, double, const Array&, Array&) override { refuse(); }
  std::unique_ptr<Differences> differences(std::size_t) override { refuse(); }
  std::unique_ptr<RowTransform> sine_transform(Index, Index) override { refuse(); }
  std::unique_ptr<Convolution> convolution(WeightsRef, Index) override { refuse(); }
  std::unique_ptr<LcpBatch> shifted_lcp(const LcpMatrix&, LcpClass, double, Index) override { refuse(); }
  std::unique_ptr<March> march(const MarchProblem&, Index) override { refuse(); }

 private:
  static RowMatrix& values(Array& array) { return static_cast<CountedArray&>(array).values; }
  static void count(const char* way, Index rows, Index cols) {
    if (const char* file = std::getenv("BROMWICH_PRETENDED_COPIES"))
      std::ofstream(file, std::ios::app) << way << " " << rows << " " << cols << "\n";
  }
  [[noreturn]] static void refuse() { throw Error("backend", "found one of scenes alone", "use another"); }
};

}  // namespace

std::vector<std::string> cuda_devices() { return {"naive loops", "more of them"}; }
bool cuda_built() { return true; }

std::unique_ptr<Backend> make_cuda_backend(std::unique_ptr<Backend> host, int device) {
  if (host->threads() == 3)
    throw Error("device", std::to_string(device) + " is at work", "try again", ErrorKind::device);
  if (host->threads() == 4) return make_row_backend();
  if (host->threads() == 5) return std::make_unique<CountedBackend>();
  BackendTraits traits;
  traits.one_at_a_time = host->threads() != 2;
  traits.fewest_values = 1000;
  return make_reference_backend(traits);
}

CudaCeilings cuda_ceilings() { return {}; }
CudaTransformSeconds cuda_transform_seconds(Index, Index) { return {}; }

}  // namespace bromwich
