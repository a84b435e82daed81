#include "files/time_vector.hpp"

#include "core/base/error.hpp"
#include "files/formula.hpp"
#include "files/mu_parser.hpp"
#include "files/names.hpp"
#include "files/shared_program.hpp"

#include <algorithm>
#include <mutex>
#include <set>
#include <utility>

namespace bromwich {

namespace {

/// muParser evaluates several results in one call, but rejects long texts: expressions share a parser up to this
/// length.
constexpr std::size_t longest_batch = 4000;
constexpr std::size_t most_programs = 100;  ///< that are kept

/// The parsers of one thread. muParser stores the addresses of variables, so they must not be moved.
class ParserSet {
 public:
  ParserSet(const std::vector<std::string>& texts, const ParameterValues& constants,
            const std::vector<std::string>& variables)
      : values_(variables.size(), 0) {
    for (std::size_t begin = 0; begin < texts.size();) {
      std::string batch;
      std::size_t end = begin;
      for (; end < texts.size() && (end == begin || batch.size() + texts[end].size() < longest_batch); ++end)
        batch += (end == begin ? "(" : ",(") + texts[end] + ")";
      parsers_.push_back(std::unique_ptr<mu::Parser>(new mu::Parser(make_parser(constants))));
      mu::Parser& parser = *parsers_.back();
      parser.DefineVar("t", &t_);
      for (std::size_t i = 0; i < variables.size(); ++i) parser.DefineVar(variables[i], &values_[i]);
      parser.SetExpr(batch);
      begin = end;
    }
  }
  ParserSet(const ParserSet&) = delete;
  ParserSet& operator=(const ParserSet&) = delete;

  /// Calls `write` for every value, in the order of the texts.
  template <typename Write>
  void evaluate(double t, const std::vector<double>& values, const Write& write) {
    t_ = t;
    std::copy(values.begin(), values.end(), values_.begin());
    std::size_t next = 0;
    for (const auto& parser : parsers_) {
      int count = 0;
      const double* of_texts = parser->Eval(count);
      for (int i = 0; i < count; ++i) write(next++, of_texts[i]);
    }
  }

 private:
  double t_ = 0;
  std::vector<double> values_;
  std::vector<std::unique_ptr<mu::Parser>> parsers_;
};

std::vector<std::string> used_in(const std::vector<std::string>& texts, const ParameterValues& parameters) {
  std::set<std::string> used;
  for (const std::string& text : texts)
    for (const Name& name : names_in(text))
      if (!name.called && parameters.contains(name.text)) used.insert(name.text);
  return {used.begin(), used.end()};
}

bool can_be_shared(const std::vector<std::string>& texts, const std::vector<std::string>& used) {
  std::map<std::string, std::size_t> numbers;
  for (std::size_t i = 0; i < used.size(); ++i) numbers[used[i]] = i;
  return std::all_of(texts.begin(), texts.end(), [&](const std::string& text) {
    try {
      return same_with_variables(read_formula(text, {}, "expression", numbers));
    } catch (const Error&) {  // nested too deeply
      return false;
    }
  });
}

}  // namespace

/// Parser sets that no thread is using. A thread takes one, or makes one if all are in use.
class Programs::Program {
 public:
  Program(std::vector<std::string> texts, ParameterValues constants, std::vector<std::string> variables)
      : texts_(std::move(texts)), constants_(std::move(constants)), variables_(std::move(variables)) {}

  template <typename Write>
  void evaluate(double t, const std::vector<double>& values, const Write& write) {
    std::unique_ptr<ParserSet> set = take();
    set->evaluate(t, values, write);
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
    return std::make_unique<ParserSet>(texts_, constants_, variables_);
  }

  std::vector<std::string> texts_;
  ParameterValues constants_;
  std::vector<std::string> variables_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<ParserSet>> idle_;
};

std::shared_ptr<Programs::Program> Programs::of(const std::vector<std::string>& texts,
                                                const ParameterValues& parameters, std::vector<std::string>& used) {
  std::string key;
  for (const std::string& text : texts) key += text + '\n';
  auto known = kept_.find(key);
  if (known == kept_.end()) {
    if (kept_.size() >= most_programs) kept_.clear();
    Kept made{used_in(texts, parameters), nullptr};
    if (can_be_shared(texts, made.used)) made.program = std::make_shared<Program>(texts, ParameterValues(), made.used);
    known = kept_.emplace(key, std::move(made)).first;
  }
  if (!known->second.program) return std::make_shared<Program>(texts, parameters, std::vector<std::string>());
  used = known->second.used;
  return known->second.program;
}

namespace {

class TimeVector {
 public:
  TimeVector(Vector constants, const std::vector<std::pair<Index, std::string>>& texts,
             const ParameterValues& parameters, Programs& programs)
      : constants_(std::move(constants)) {
    std::vector<std::string> of_program, used;
    for (const auto& [row, text] : texts) {
      if (!parsed(text)) {
        long_.emplace_back(row, read_formula(text, parameters, "expression"));
        continue;
      }
      rows_.push_back(row);
      of_program.push_back(text);
    }
    if (!rows_.empty()) program_ = programs.of(of_program, parameters, used);
    for (const std::string& name : used) values_.push_back(parameters.at(name));
  }

  void operator()(double t, Eigen::Ref<Vector> value) const {
    value = constants_;
    for (const auto& [row, formula] : long_) value[row] = formula(t);
    if (program_) program_->evaluate(t, values_, [&](std::size_t i, double entry) { value[rows_[i]] = entry; });
  }

 private:
  Vector constants_;
  std::vector<Index> rows_;  ///< of the entries of the program
  std::vector<std::pair<Index, Formula>> long_;
  std::shared_ptr<Programs::Program> program_;
  std::vector<double> values_;  ///< of its variables
};

}  // namespace

TimeFunction time_vector(Vector constants, const std::vector<std::pair<Index, std::string>>& texts,
                         const ParameterValues& parameters, Programs& programs) {
  const auto function = std::make_shared<const TimeVector>(std::move(constants), texts, parameters, programs);
  return [function](double t, Eigen::Ref<Vector> value) { (*function)(t, value); };
}

}  // namespace bromwich
