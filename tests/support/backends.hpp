#pragma once
// The backends of the contract tests, and helpers of these tests.

#include "core/seam/backend.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/reference_backend.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <memory>
#include <ostream>
#include <string>
#include <vector>

namespace bromwich {

struct BackendCase {
  std::string name;
  std::unique_ptr<Backend> (*make)();
};

inline void PrintTo(const BackendCase& c, std::ostream* out) { *out << c.name; }

/// CPU with one thread, with two, and with more threads than cores or blocks of modes; naive loops; CUDA if there is a
/// device.
inline std::vector<BackendCase> backend_cases() {
  std::vector<BackendCase> cases{{"cpu1", [] { return make_cpu_backend(1); }},
                                 {"cpu2", [] { return make_cpu_backend(2); }},
                                 {"cpu7", [] { return make_cpu_backend(7); }},
                                 {"reference", [] { return make_reference_backend(); }}};
  if (!cuda_devices().empty()) cases.push_back({"cuda", [] { return make_cuda_backend(make_cpu_backend(2)); }});
  return cases;
}

inline std::string backend_case_name(const testing::TestParamInfo<BackendCase>& info) { return info.param.name; }

class BackendTest : public testing::TestWithParam<BackendCase> {
 protected:
  std::unique_ptr<Array> device(const RowMatrix& values) {
    auto array = backend->array(values.rows(), values.cols());
    backend->upload(values, *array);
    return array;
  }
  RowMatrix host(const Array& array) {
    RowMatrix values;
    backend->download(array, values);
    return values;
  }

  std::unique_ptr<Backend> backend = GetParam().make();
};

/// Compares the CPU with CUDA; skipped if there is no device.
class BothBackends : public testing::Test {
 protected:
  void SetUp() override {
    if (cuda_devices().empty())
      GTEST_SKIP() << "no CUDA device: " << (cuda_built() ? "the driver reports none" : "built without CUDA");
    cpu = make_cpu_backend(2);
    cuda = make_cuda_backend(make_cpu_backend(2));
  }

  std::unique_ptr<Backend> cpu, cuda;
};

}  // namespace bromwich
