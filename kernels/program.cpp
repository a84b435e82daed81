// Operations recorded as a CUDA graph: one launch for all kernels.

#include "kernels/parts.hpp"

namespace bromwich::cuda {

namespace {

/// Kernels over more values take longer than their launches.
constexpr Index most_values = Index(1) << 22;

class Graph {
 public:
  Graph(const Device& device, const std::function<void()>& operations) : device_(device), stream_(device.stream()) {
    device.retired_graphs().destroy();
    cudaGraph_t graph = nullptr;
    check(cudaStreamBeginCapture(stream_, cudaStreamCaptureModeThreadLocal), "recording operations");
    try {
      operations();
    } catch (...) {
      cudaStreamEndCapture(stream_, &graph);
      cudaGraphDestroy(graph);
      throw;
    }
    check(cudaStreamEndCapture(stream_, &graph), "recording operations");
    const cudaError_t status = cudaGraphInstantiate(&executable_, graph, 0);
    cudaGraphDestroy(graph);
    check(status, "recording operations");
    check(cudaGraphUpload(executable_, stream_), "recording operations");  // otherwise the first run uploads it
  }
  ~Graph() { device_.retired_graphs().add(executable_); }
  Graph(const Graph&) = delete;
  Graph& operator=(const Graph&) = delete;

  void run() const {
    device_.note_work();
    check(cudaGraphLaunch(executable_, stream_), "starting recorded operations");
  }

 private:
  const Device& device_;
  cudaStream_t stream_;
  cudaGraphExec_t executable_ = nullptr;
};

}  // namespace

std::function<void()> record(const Device& device, Index values, const std::function<void()>& operations) {
  if (values > most_values) return {};
  return [graph = std::make_shared<const Graph>(device, operations)] { graph->run(); };
}

}  // namespace bromwich::cuda
