// Arrays with two stages in each step, copied to the host and back.

#include "core/seam/backend.hpp"

namespace bromwich {

namespace {

void take_stages(Backend& backend, const Array& stages, Array& first, Array& second) {
  RowMatrix all, odd = RowMatrix::Zero(first.rows(), first.cols()), even(first.rows(), first.cols());
  backend.download(stages, all);
  for (Index j = 0; j < first.rows(); ++j) {
    if (j > 0) odd.row(j) = all.row(2 * j - 1);
    even.row(j) = all.row(2 * j);
  }
  backend.upload(odd, first);
  backend.upload(even, second);
}

void put_stages(Backend& backend, const Array& first, const Array& second, Array& stages) {
  RowMatrix odd, even, all(stages.rows(), stages.cols());
  backend.download(first, odd);
  backend.download(second, even);
  all.row(0) = even.row(0);
  for (Index j = 1; j < first.rows(); ++j) {
    all.row(2 * j - 1) = odd.row(j);
    all.row(2 * j) = even.row(j);
  }
  backend.upload(all, stages);
}

void sweep_stages(Backend& backend, const StageDivisors& d, const Array& r, const Array& v, Array& y) {
  RowMatrix known, far, values;
  backend.download(r, known);
  backend.download(v, far);
  backend.download(y, values);
  known += far;
  for (Index j = 1; 2 * j < values.rows(); ++j) {
    const Vector before = values.row(2 * j - 1).transpose();
    values.row(2 * j - 1) = (values.row(2 * j - 1) - known.row(2 * j - 1) / d.first).cwiseMax(0);
    const Vector change = values.row(2 * j - 1).transpose() - before;
    values.row(2 * j) =
        (values.row(2 * j) - (known.row(2 * j) + d.second_by_first * change.transpose()) / d.second).cwiseMax(0);
  }
  backend.upload(values, y);
}

void restrict_stages(Backend& backend, const Array& r, const Array& v, const Array& y, const Array& coarse_v,
                     Array& coarse_r, Array& coarse_y, Array& old) {
  backend.restrict_problem(r, v, y, coarse_v, coarse_r, coarse_y, old);
  RowMatrix known, far, values, result;
  backend.download(r, known);
  backend.download(v, far);
  backend.download(y, values);
  backend.download(coarse_r, result);
  known += far;
  for (Index j = 1; j < result.rows(); ++j)
    for (Index i = 0; i < result.cols(); ++i)
      if ((values(2 * j - 1, i) > 0) == (values(2 * j, i) > 0))
        result(j, i) += 0.75 * (known(2 * j - 1, i) - known(2 * j, i));
  backend.upload(result, coarse_r);
}

}  // namespace

StageOperations stages_by_host(Backend& backend) {
  StageOperations all;
  all.take_stages = [&backend](const Array& stages, Array& first, Array& second) {
    take_stages(backend, stages, first, second);
  };
  all.put_stages = [&backend](const Array& first, const Array& second, Array& stages) {
    put_stages(backend, first, second, stages);
  };
  all.sweep_stages = [&backend](const StageDivisors& d, const Array& r, const Array& v, Array& y) {
    sweep_stages(backend, d, r, v, y);
  };
  all.restrict_stages = [&backend](const Array& r, const Array& v, const Array& y, const Array& coarse_v,
                                   Array& coarse_r, Array& coarse_y, Array& old) {
    restrict_stages(backend, r, v, y, coarse_v, coarse_r, coarse_y, old);
  };
  return all;
}

}  // namespace bromwich
