// What stands for an optional operation where a backend has none, against the operation of the backends that have it.

#include "tests/support/backends.hpp"

#include <cmath>

namespace bromwich {
namespace {

using reference::Random;

class FusedOperationsTest : public BackendTest {
 protected:
  std::unique_ptr<Backend> plain = make_reference_backend();  // it has none

  std::unique_ptr<Array> plain_array(const RowMatrix& values) {
    auto array = plain->array(values.rows(), values.cols());
    plain->upload(values, *array);
    return array;
  }
  RowMatrix values_of(const Array& array) {
    RowMatrix values;
    plain->download(array, values);
    return values;
  }
};

INSTANTIATE_TEST_SUITE_P(Contract, FusedOperationsTest, testing::ValuesIn(backend_cases()), backend_case_name);

TEST_P(FusedOperationsTest, ANaiveBackendHasNone) {
  const FusedOperations& fused = plain->fused();
  EXPECT_FALSE(fused.record || fused.upload_product || fused.upload_projection || fused.download_during ||
               fused.restrict_problem || fused.alternates || fused.step_chain || fused.affine_chain || fused.resolvent);
  EXPECT_FALSE(plain->record(1, [] {}));
}

TEST_P(FusedOperationsTest, ACoarseProblem) {
  Random random(1);
  const Index n = 5, coarse_rows = 9, rows = 33;
  const RowMatrix r = random.matrix(rows, n), v = random.matrix(rows, n), y = random.matrix(rows, n),
                  coarse_v = random.matrix(coarse_rows, n);
  const auto coarse_r = backend->array(coarse_rows, n), coarse_y = backend->array(coarse_rows, n),
             old = backend->array(coarse_rows, n);
  backend->restrict_problem(*device(r), *device(v), *device(y), *device(coarse_v), *coarse_r, *coarse_y, *old);
  const auto plain_r = plain->array(coarse_rows, n), plain_y = plain->array(coarse_rows, n),
             plain_old = plain->array(coarse_rows, n);
  plain->restrict_problem(*plain_array(r), *plain_array(v), *plain_array(y), *plain_array(coarse_v), *plain_r, *plain_y,
                          *plain_old);
  EXPECT_LE(distance(host(*coarse_r), values_of(*plain_r)), 4 * epsilon);
  EXPECT_EQ(host(*coarse_y), values_of(*plain_y));
  EXPECT_EQ(host(*old), values_of(*plain_old));
}

TEST_P(FusedOperationsTest, ProductsOnTheirWay) {
  Random random(2);
  const RowMatrix a = random.matrix(7, 3);
  const Matrix shapes = random.matrix(11, 3);
  const auto product = backend->array(9, 11), expected = plain->array(9, 11);
  backend->upload_product(a, shapes, *product);
  plain->upload_product(a, shapes, *expected);
  EXPECT_LE(distance(host(*product).topRows(7), values_of(*expected).topRows(7)), 16 * epsilon);

  const Index k = 4, m = 70, n = 130;
  const RowMatrix P = random.matrix(k, m), X = random.matrix(n, m);
  const Vector values = Eigen::Map<const Vector>(X.data(), X.size());
  const auto projection = backend->array(k, n), known = plain->array(k, n);
  backend->upload_projection(values, *device(P), *projection);
  plain->upload_projection(values, *plain_array(P), *known);
  EXPECT_LE(distance(host(*projection), P * X.transpose()), 2 * double(m) * epsilon * std::sqrt(double(m)));
  EXPECT_LE(distance(values_of(*known), P * X.transpose()), 2 * double(m) * epsilon * std::sqrt(double(m)));
}

TEST_P(FusedOperationsTest, ValuesThatAlternate) {
  const Index rows = 80, run = 16;
  for (const Index length : {0, 15, 16, 40}) {
    RowMatrix y(rows, 3);
    for (Index j = 0; j < rows; ++j) {
      const double swing = j >= 20 && j < 22 + length ? (j % 2 == 0 ? 0.2 : -0.2) : 0;
      y.row(j) << 1, std::cos(0.05 * double(j)) + swing, 1e-20;
    }
    EXPECT_EQ(backend->alternates(*device(y), run, 0.01), plain->alternates(*plain_array(y), run, 0.01)) << length;
    if (length == 0 || length == 40) {
      EXPECT_EQ(backend->alternates(*device(y), run, 0.01), length > run) << length;
    }
  }
}

TEST_P(FusedOperationsTest, WorkDuringADownload) {
  RowMatrix to;
  int calls = 0;
  const auto array = device(RowMatrix::Ones(4, 2));
  backend->download_during(*array, to, [&] { ++calls; });
  EXPECT_EQ(calls, 1);
  EXPECT_EQ(to, RowMatrix::Ones(4, 2));
}

}  // namespace
}  // namespace bromwich
