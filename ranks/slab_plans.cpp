#include "ranks/slab_plans.hpp"

#include <algorithm>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

class SlabTransform final : public RowTransform {
 public:
  SlabTransform(std::unique_ptr<RowTransform> local, const Slabs& slabs) : local_(std::move(local)), slabs_(slabs) {}

  void apply(const Array& in, const Array* add, Array& out, Index first) override {
    const Index here = slabs_.here(first);
    if (here < slabs_.rows()) local_->apply(local_part(in), add ? &local_part(*add) : nullptr, local_part(out), here);
  }
  std::size_t bytes() const override { return local_->bytes(); }
  RowTransform& local() { return *local_; }

 private:
  std::unique_ptr<RowTransform> local_;
  Slabs slabs_;
};

class SlabLcp final : public LcpBatch {
 public:
  SlabLcp(const RankedBackend& ranked, std::unique_ptr<LcpBatch> local, const Slabs& slabs)
      : LcpBatch(false, local->recorded), ranked_(ranked), local_(std::move(local)), slabs_(slabs) {
    if (!local_->submit_in_modes) return;
    submit_in_modes = [this](RowTransform& S, const Array& r, const Array& v, bool v_in_modes, Array& y, Array* y_modes,
                             Index first) {
      const Index here = slabs_.here(first);
      if (here < slabs_.rows())
        local_->submit_in_modes(static_cast<SlabTransform&>(S).local(), local_part(r), local_part(v), v_in_modes,
                                local_part(y), y_modes ? &local_part(*y_modes) : nullptr, here);
    };
  }

  void submit(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    const Index here = slabs_.here(first);
    if (here < slabs_.rows()) local_->submit(local_part(r), local_part(v), local_part(y), here, settle_tolerance);
  }
  LcpReport finish(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    const Index here = slabs_.here(first);
    LcpReport own;
    own.settled = here;
    if (here < slabs_.rows()) own = local_->finish(local_part(r), local_part(v), local_part(y), here, settle_tolerance);
    return of_all(own);
  }
  LcpReport collect() override { return of_all(local_->collect()); }

  double residual(const Array& r, const Array& v, const Array& y) override {
    if (slabs_.whole()) return local_->residual(local_part(r), local_part(v), local_part(y));
    for (const Array* array : {&r, &v, &y}) ranked_.clear_row_before(*array);
    Vector worst = Vector::Constant(1, local_->residual(local_part(r), local_part(v), local_part(y)));
    ranked_.communicator.maximum(worst);
    return worst[0];
  }

  std::size_t bytes() const override { return local_->bytes(); }

 private:
  enum Place { solved, newton, fallbacks, unsolved, change, magnitude, settled, infeasible, finite, places };

  // Rows are counted over all ranks from here on; those that have settled end at the first rank with others.
  LcpReport of_all(const LcpReport& own) const {
    if (slabs_.whole()) return own;
    Vector mine(static_cast<Index>(places));
    mine << double(own.count.solved), double(own.count.newton), double(own.count.fallbacks), double(own.count.unsolved),
        own.change, own.magnitude, double(slabs_.first() + own.settled),
        own.infeasible < 0 ? -1 : double(slabs_.first() + own.infeasible), double(own.finite);
    const RowMatrix of_ranks = ranked_.communicator.gather(mine);
    LcpReport all;
    all.settled = slabs_.steps + 1;
    for (int r = 0; r < int(of_ranks.rows()); ++r) {
      const auto one = of_ranks.row(r);
      all.count.solved += long(one[solved]);
      all.count.newton += long(one[newton]);
      all.count.fallbacks += long(one[fallbacks]);
      all.count.unsolved += long(one[unsolved]);
      all.change = std::max(one[change], all.change);
      all.magnitude = std::max(one[magnitude], all.magnitude);
      all.finite = all.finite && one[finite] > 0;
      if (all.infeasible < 0) all.infeasible = Index(one[infeasible]);
      const Index end = slabs_.begin(r) + slabs_.count(r) + 1;
      if (Index(one[settled]) < end) all.settled = std::min(all.settled, Index(one[settled]));
    }
    return all;
  }

  RankedBackend ranked_;
  std::unique_ptr<LcpBatch> local_;
  Slabs slabs_;
};

class SlabDifferences final : public Differences {
 public:
  SlabDifferences(const RankedBackend& ranked, std::size_t slots)
      : ranked_(ranked), local_(ranked.local.differences(slots)), values_(slots, 0) {}

  void submit(std::size_t slot, const Array& a, const Array& b) override {
    const bool divided = !slab(a).slabs.whole();
    if (divided)
      for (const Array* array : {&a, &b}) ranked_.clear_row_before(*array);
    local_->submit(slot, local_part(a), local_part(b));
    divided_ = divided_ || divided;
    known_ = false;
  }
  const std::vector<double>& collect() override {
    if (known_) return values_;
    values_ = local_->collect();
    if (divided_) {
      Vector largest = Eigen::Map<Vector>(values_.data(), Index(values_.size()));
      ranked_.communicator.maximum(largest);
      std::copy_n(largest.data(), values_.size(), values_.begin());
    }
    known_ = true;
    return values_;
  }
  std::size_t bytes() const override { return local_->bytes(); }

 private:
  RankedBackend ranked_;
  std::unique_ptr<Differences> local_;
  std::vector<double> values_;
  bool known_ = true, divided_ = false;
};

class WholeConvolution final : public Convolution {
 public:
  WholeConvolution(const RankedBackend& ranked, std::unique_ptr<Convolution> plan, const Slabs& slabs, Index cols)
      : ranked_(ranked), plan_(std::move(plan)) {
    if (!slabs.whole())
      for (auto* array : {&y_, &v_}) *array = ranked.local.array(slabs.steps + 1, cols);
    if (!plan_->start_from) return;
    start_from = [this](const Array& D) {
      ranked_.download(D, values_);
      if (!start_) start_ = ranked_.local.array(D.rows(), D.cols());
      ranked_.local.upload(values_, *start_);
      plan_->start_from(*start_);
    };
  }

  void apply(const Array& y, Array& v, Index first) override {
    if (!y_) return plan_->apply(local_part(y), local_part(v), first);
    ranked_.download(y, values_);
    ranked_.local.upload(values_, *y_);
    plan_->apply(*y_, *v_, first);
    ranked_.local.download(*v_, values_);
    ranked_.upload(values_, v);
  }
  bool recorded() const override { return !y_ && plan_->recorded(); }
  std::size_t bytes() const override { return plan_->bytes() + (y_ ? y_->bytes() + v_->bytes() : 0); }

 private:
  RankedBackend ranked_;
  std::unique_ptr<Convolution> plan_;
  std::unique_ptr<Array> y_, v_, start_;  ///< y_, v_: all rows; null for whole arrays
  RowMatrix values_;
};

class SlabMarch final : public March {
 public:
  SlabMarch(const RankedBackend& ranked, const MarchProblem& problem, const Slabs& slabs)
      : March(false), ranked_(ranked), problem_(problem), slabs_(slabs) {
    MarchProblem local = problem;
    if (slabs.whole()) {
      for (const Array** array : {&local.r, &local.drive, &local.forcing})
        if (*array) *array = &local_part(**array);
    } else {
      const auto all_rows = [&](const Array* divided, std::unique_ptr<Array>& whole) -> const Array* {
        if (!divided) return nullptr;
        whole = ranked.local.array(divided->rows(), divided->cols());
        return whole.get();
      };
      local.r = all_rows(problem.r, r_);
      local.drive = all_rows(problem.drive, drive_);
      local.forcing = all_rows(problem.forcing, forcing_);
      const Index n = problem.r->cols();
      y_ = ranked.local.array(slabs.steps + 1, n);
      v_ = ranked.local.array(slabs.steps + 1, n);
    }
    plan_ = ranked.local.march(local, slabs.steps + 1);
  }

  void submit(Array& y, Array& v) override {
    if (slabs_.whole()) return plan_->submit(local_part(y), local_part(v));
    take(y);
    plan_->submit(*y_, *v_);
    give(y, v);
  }
  MarchReport collect() override { return plan_->collect(); }
  MarchReport run(Array& y, Array& v) override {
    if (slabs_.whole()) return plan_->run(local_part(y), local_part(v));
    take(y);
    const MarchReport report = plan_->run(*y_, *v_);
    give(y, v);
    return report;
  }

  std::size_t bytes() const override {
    std::size_t sum = plan_->bytes();
    for (const auto* array : {&r_, &drive_, &forcing_, &y_, &v_})
      if (*array) sum += (*array)->bytes();
    return sum;
  }

 private:
  void take(const Array& y) {
    fill(&y, *y_);
    fill(problem_.r, *r_);
    if (drive_) fill(problem_.drive, *drive_);
    if (forcing_) fill(problem_.forcing, *forcing_);
  }
  void fill(const Array* divided, Array& whole) {
    ranked_.download(*divided, values_);
    ranked_.local.upload(values_, whole);
  }
  void give(Array& y, Array& v) {
    ranked_.local.download(*y_, values_);
    ranked_.upload(values_, y);
    ranked_.local.download(*v_, values_);
    ranked_.upload(values_, v);
  }

  RankedBackend ranked_;
  MarchProblem problem_;
  Slabs slabs_;
  std::unique_ptr<March> plan_;
  std::unique_ptr<Array> r_, drive_, forcing_, y_, v_;  ///< all rows; null for whole arrays
  RowMatrix values_;
};

}  // namespace

std::unique_ptr<RowTransform> make_slab_transform(std::unique_ptr<RowTransform> local, const Slabs& slabs) {
  return std::make_unique<SlabTransform>(std::move(local), slabs);
}
std::unique_ptr<LcpBatch> make_slab_lcp(const RankedBackend& ranked, std::unique_ptr<LcpBatch> local,
                                        const Slabs& slabs) {
  return std::make_unique<SlabLcp>(ranked, std::move(local), slabs);
}
std::unique_ptr<Differences> make_slab_differences(const RankedBackend& ranked, std::size_t slots) {
  return std::make_unique<SlabDifferences>(ranked, slots);
}
std::unique_ptr<Convolution> make_whole_convolution(const RankedBackend& ranked, std::unique_ptr<Convolution> whole,
                                                    const Slabs& slabs, Index cols) {
  return std::make_unique<WholeConvolution>(ranked, std::move(whole), slabs, cols);
}
std::unique_ptr<March> make_slab_march(const RankedBackend& ranked, const MarchProblem& problem, const Slabs& slabs) {
  return std::make_unique<SlabMarch>(ranked, problem, slabs);
}

}  // namespace bromwich
