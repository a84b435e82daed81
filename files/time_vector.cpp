#include "files/time_vector.hpp"

#include "files/formula.hpp"
#include "files/mu_parser.hpp"

#include <memory>
#include <mutex>

namespace bromwich {

namespace {

/// muParser evaluates several results in one call, but rejects long texts: expressions share a parser up to this
/// length.
constexpr std::size_t longest_batch = 4000;

/// The parsers of one thread. muParser stores the address of t, so they must not be moved.
class ParserSet {
 public:
  ParserSet(const std::vector<std::string>& texts, const ParameterValues& parameters) {
    for (std::size_t begin = 0; begin < texts.size();) {
      std::string batch;
      std::size_t end = begin;
      for (; end < texts.size() && (end == begin || batch.size() + texts[end].size() < longest_batch); ++end)
        batch += (end == begin ? "(" : ",(") + texts[end] + ")";
      parsers_.push_back(make_parser(parameters));
      parsers_.back().DefineVar("t", &t_);
      parsers_.back().SetExpr(batch);
      begin = end;
    }
  }
  ParserSet(const ParserSet&) = delete;
  ParserSet& operator=(const ParserSet&) = delete;

  /// Calls `write` for every value, in the order of the texts.
  template <typename Write>
  void evaluate(double t, const Write& write) {
    t_ = t;
    std::size_t next = 0;
    for (mu::Parser& parser : parsers_) {
      int count = 0;
      const double* values = parser.Eval(count);
      for (int i = 0; i < count; ++i) write(next++, values[i]);
    }
  }

 private:
  double t_ = 0;
  std::vector<mu::Parser> parsers_;
};

/// Parser sets that no thread is using. A thread takes one, or makes one if all are in use.
class TimeVector {
 public:
  TimeVector(Vector constants, ParameterValues parameters)
      : constants_(std::move(constants)), parameters_(std::move(parameters)) {}

  /// Value of entry `row`; its text was checked before.
  void add(Index row, const std::string& text) {
    if (!parsed(text)) {
      long_.emplace_back(row, read_formula(text, parameters_, "expression"));
      return;
    }
    rows_.push_back(row);
    texts_.push_back(text);
  }

  void operator()(double t, Eigen::Ref<Vector> value) {
    value = constants_;
    for (const auto& [row, formula] : long_) value[row] = formula(t);
    if (rows_.empty()) return;
    std::unique_ptr<ParserSet> set = take();
    set->evaluate(t, [&](std::size_t i, double entry) { value[rows_[i]] = entry; });
    const std::lock_guard lock(mutex_);
    idle_.push_back(std::move(set));
  }

 private:
  std::unique_ptr<ParserSet> take() {
    {
      const std::lock_guard lock(mutex_);
      if (!idle_.empty()) {
        auto set = std::move(idle_.back());
        idle_.pop_back();
        return set;
      }
    }
    return std::make_unique<ParserSet>(texts_, parameters_);
  }

  Vector constants_;
  std::vector<Index> rows_;  ///< texts_[i] is the entry rows_[i]
  std::vector<std::string> texts_;
  std::vector<std::pair<Index, Formula>> long_;
  ParameterValues parameters_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<ParserSet>> idle_;
};

}  // namespace

TimeFunction time_vector(Vector constants, const std::vector<std::pair<Index, std::string>>& texts,
                         const ParameterValues& parameters) {
  auto function = std::make_shared<TimeVector>(std::move(constants), parameters);
  for (const auto& [row, text] : texts) function->add(row, text);
  return [function](double t, Eigen::Ref<Vector> value) { (*function)(t, value); };
}

}  // namespace bromwich
