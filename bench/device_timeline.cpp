// What a CUDA device does, and when: a library that the CUDA driver loads into a program.
//
//     CUDA_INJECTION64_PATH=libbromwich_device_timeline.so BROMWICH_TIMELINE=FILE BROMWICH_TIMELINE_SECONDS=10 bromwich
//     ...
//
// Writes FILE.RANK.json at the end, or after these seconds, which then end the program (several ranks do not come to an
// end under CUPTI). RANK is that of Open MPI, or 0. The file has kernels and copies with their begin, duration (ns),
// stream, and number of blocks (kernels) or bytes (copies). Recording makes kernels of CUDA graphs begin later, by
// about a microsecond each. scripts/bench_timeline reads the files.

#include <cupti.h>
#include <cxxabi.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace {

struct Event {
  uint64_t start = 0, nanoseconds = 0;
  int name = 0;
  uint32_t stream = 0;
  uint64_t blocks = 0;  ///< of a kernel; bytes of a copy
};

class Timeline {
 public:
  void add(uint64_t start, uint64_t end, const std::string& name, uint32_t stream, uint64_t blocks) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto [at, fresh] = numbers_.try_emplace(name, int(names_.size()));
    if (fresh) names_.push_back(readable(name));
    events_.push_back({start, end - start, at->second, stream, blocks});
  }

  void write() {
    const char* file = std::getenv("BROMWICH_TIMELINE");
    if (!file) return;
    const char* rank = std::getenv("OMPI_COMM_WORLD_RANK");
    std::sort(events_.begin(), events_.end(), [](const Event& a, const Event& b) { return a.start < b.start; });
    nlohmann::json events = nlohmann::json::array();
    for (const Event& e : events_) events.push_back({e.start, e.nanoseconds, e.name, e.stream, e.blocks});
    std::ofstream(std::string(file) + "." + (rank ? rank : "0") + ".json")
        << nlohmann::json{{"columns", {"start", "nanoseconds", "name", "stream", "blocks"}},
                          {"names", names_},
                          {"events", std::move(events)}};
  }

 private:
  // Without arguments.
  static std::string readable(const std::string& mangled) {
    int failed = 0;
    char* text = abi::__cxa_demangle(mangled.c_str(), nullptr, nullptr, &failed);
    std::string name = failed ? mangled : text;
    std::free(text);
    const auto arguments = name.rfind('(');
    return arguments == std::string::npos ? name : name.substr(0, arguments);
  }

  std::mutex mutex_;
  std::map<std::string, int> numbers_;
  std::vector<std::string> names_;
  std::vector<Event> events_;
};

Timeline& timeline() {
  static auto* const kept = new Timeline;  // outlives the exit handlers
  return *kept;
}

constexpr std::size_t buffer_bytes = 8 << 20;

void CUPTIAPI give_buffer(uint8_t** buffer, std::size_t* size, std::size_t* most_records) {
  *buffer = static_cast<uint8_t*>(std::aligned_alloc(8, buffer_bytes));
  *size = buffer_bytes;
  *most_records = 0;
}

void CUPTIAPI take_buffer(CUcontext, uint32_t, uint8_t* buffer, std::size_t, std::size_t valid) {
  CUpti_Activity* record = nullptr;
  while (cuptiActivityGetNextRecord(buffer, valid, &record) == CUPTI_SUCCESS) {
    if (record->kind == CUPTI_ACTIVITY_KIND_CONCURRENT_KERNEL) {
      const auto* k = reinterpret_cast<const CUpti_ActivityKernel10*>(record);
      timeline().add(k->start, k->end, k->name, k->streamId, uint64_t(k->gridX) * k->gridY * k->gridZ);
    } else if (record->kind == CUPTI_ACTIVITY_KIND_MEMCPY) {
      const auto* c = reinterpret_cast<const CUpti_ActivityMemcpy6*>(record);
      const char* name = c->copyKind == CUPTI_ACTIVITY_MEMCPY_KIND_DTOH   ? "copy to the host"
                         : c->copyKind == CUPTI_ACTIVITY_MEMCPY_KIND_HTOD ? "copy to the device"
                                                                          : "copy";
      timeline().add(c->start, c->end, name, c->streamId, c->bytes);
    }
  }
  std::free(buffer);
}

void finish() {
  static std::once_flag once;
  std::call_once(once, [] {
    cuptiActivityFlushAll(1);
    timeline().write();
  });
}

}  // namespace

extern "C" int InitializeInjection() {
  cuptiActivityRegisterCallbacks(give_buffer, take_buffer);
  cuptiActivityEnable(CUPTI_ACTIVITY_KIND_CONCURRENT_KERNEL);
  cuptiActivityEnable(CUPTI_ACTIVITY_KIND_MEMCPY);
  const char* seconds = std::getenv("BROMWICH_TIMELINE_SECONDS");
  std::thread([after = std::chrono::duration<double>(seconds ? std::atof(seconds) : 10)] {
    std::this_thread::sleep_for(after);
    finish();
    std::_Exit(0);
  }).detach();
  std::atexit(finish);
  return 1;
}
