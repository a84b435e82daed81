#include "tests/circuits/mode_reference.hpp"

#include "tests/circuits/reference_netlist.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

namespace bromwich::test {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using MatrixXl = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;  // small currents beside Roff and Ron
using Part = ReferencePart;

constexpr int levels = 40;  ///< step k is 2^-k of the longest
constexpr double zero_share = 64 * std::numeric_limits<double>::epsilon();
constexpr long most_changes = 1'000'000;

/// z' = G z over z = (x, 1, two of each source: its value and slope, or a sine and its cosine).
struct CircuitMode {
  MatrixXd G;
  MatrixXd currents;           ///< of all parts; of those but diodes 0
  MatrixXd kept;               ///< sums of currents that are 0, of the states
  std::vector<MatrixXd> step;  ///< exp(2^-k longest G)
};

class Simulation {
 public:
  explicit Simulation(const std::string& netlist) : net_(read_reference_netlist(netlist)), parts_(net_.parts) {
    number_states();
  }

  ReferenceValues run(const std::vector<double>& times) {
    const double T = net_.stop;
    longest_ = T / 400;
    std::vector<double> edges{0, T};
    for (const Part& p : parts_)
      if (p.source.pulses()) add_edges(p.source, edges);
    add_switch_times(edges);
    edges.insert(edges.end(), times.begin(), times.end());
    std::sort(edges.begin(), edges.end());
    x_ = VectorXd::Zero(states_);
    for (std::size_t k = 0; k < storage_.size(); ++k) x_[Index(k)] = parts_[std::size_t(storage_[k])].initial;
    mode_.assign(parts_.size(), 0);
    largest_ = x_.cwiseAbs();
    ReferenceValues r;
    auto next = times.begin();
    for (std::size_t k = 0; k + 1 < edges.size(); ++k) {
      if (edges[k + 1] - edges[k] > 1e-14 * T) advance(edges[k], edges[k + 1]);
      for (; next != times.end() && *next <= edges[k + 1]; ++next)
        for (std::size_t i = 0; i < storage_.size(); ++i) r.at[name_of(i)].push_back(x_[Index(i)]);
    }
    r.changes = changes_;
    for (std::size_t k = 0; k < storage_.size(); ++k) {
      r.end[name_of(k)] = x_[Index(k)];
      r.largest[name_of(k)] = largest_[Index(k)];
    }
    return r;
  }

 private:
  std::string name_of(std::size_t state) const {
    const Part& p = parts_[std::size_t(storage_[state])];
    return (p.kind == 'C' ? "V(" : "I(") + p.name + ")";
  }

  void number_states() {
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      if (parts_[i].kind == 'C' || parts_[i].kind == 'L') storage_.push_back(int(i));
      if (parts_[i].kind == 'V') sources_.push_back(int(i));
    }
    states_ = Index(storage_.size());
    const auto place = [&](const std::string& name) {
      for (std::size_t k = 0; k < storage_.size(); ++k)
        if (parts_[std::size_t(storage_[k])].name == name) return Index(k);
      throw std::runtime_error("no inductor " + name);
    };
    stored_ = MatrixXl::Zero(states_, states_);
    for (Index k = 0; k < states_; ++k) stored_(k, k) = parts_[std::size_t(storage_[std::size_t(k)])].value;
    for (const auto& w : net_.couplings) {
      const Index i = place(w[1]), j = place(w[2]);
      stored_(i, j) = stored_(j, i) = reference_number(w[3]) * std::sqrt(stored_(i, i) * stored_(j, j));
    }
  }

  void add_edges(const ReferenceSource& s, std::vector<double>& edges) const {
    for (double begin = s.delay; begin < net_.stop; begin += s.period)
      for (const double part : {0.0, s.rise, s.rise + s.width, s.rise + s.width + s.fall})
        if (begin + part < net_.stop) edges.push_back(begin + part);
  }

  double control(const Part& p, double t) const {
    double v = -net_.models.at(p.model).threshold;
    for (const int i : sources_) {
      const Part& s = parts_[std::size_t(i)];
      if (s.b == -1 && s.a == p.control_a) v += s.source.value(t);
      if (s.b == -1 && s.a == p.control_b) v -= s.source.value(t);
    }
    return v;
  }

  void add_switch_times(std::vector<double>& edges) const {
    std::vector<double> sorted = edges;
    std::sort(sorted.begin(), sorted.end());
    for (const Part& p : parts_) {
      if (p.kind != 'S') continue;
      for (std::size_t k = 0; k + 1 < sorted.size(); ++k)
        for (int part = 0; part < 3; ++part) {
          constexpr double marks[] = {1e-9, 0.31, 0.63, 1 - 1e-9};  // no crossing lies at one of them
          const double span = sorted[k + 1] - sorted[k];
          double low = sorted[k] + span * marks[part], high = sorted[k] + span * marks[part + 1];
          const bool begin = control(p, low) > 0;
          if (!(span > 0) || begin == (control(p, high) > 0)) continue;
          for (int i = 0; i < 60; ++i) {
            const double middle = (low + high) / 2;
            ((control(p, middle) > 0) == begin ? low : high) = middle;
          }
          edges.push_back(high);
        }
    }
  }

  Index width() const { return states_ + 1 + 2 * Index(sources_.size()); }

  /// The mode of mode_, made once.
  const CircuitMode& mode() {
    CircuitMode& m = modes_[mode_];
    if (m.G.size() > 0) return m;
    m = make_mode();
    m.step.resize(levels);
    for (int k = levels - 1; k >= 0; --k) {
      const MatrixXd hG = std::ldexp(longest_, -k) * m.G;
      if (hG.cwiseAbs().rowwise().sum().maxCoeff() > 0.5 && k < levels - 1) {
        m.step[std::size_t(k)] = m.step[std::size_t(k) + 1] * m.step[std::size_t(k) + 1];
        continue;
      }
      MatrixXd& sum = m.step[std::size_t(k)];
      MatrixXd term = sum = MatrixXd::Identity(width(), width());
      for (int i = 1; i <= 18; ++i) sum += term = (term * hG / i).eval();
    }
    return m;
  }

  CircuitMode make_mode() const {
    const Index n = Index(net_.nodes.size());
    std::vector<int> forced;  // parts whose current is an unknown
    for (std::size_t i = 0; i < parts_.size(); ++i)
      if (std::string("VCD").find(parts_[i].kind) != std::string::npos) forced.push_back(int(i));
    const Index all = n + Index(forced.size());
    MatrixXl P = MatrixXl::Zero(all, all), Q = MatrixXl::Zero(all, width());
    const auto at = [](MatrixXl& m, Index i, Index j, double v) {
      if (i >= 0 && j >= 0) m(i, j) += v;
    };
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const Part& p = parts_[i];
      double g = 0;
      if (p.kind == 'R') g = 1 / p.value;
      if (p.kind == 'S') g = conductance(p, mode_[i]);
      at(P, p.a, p.a, g), at(P, p.b, p.b, g), at(P, p.a, p.b, -g), at(P, p.b, p.a, -g);
      if (p.kind == 'L') at(Q, p.a, state_of(int(i)), -1), at(Q, p.b, state_of(int(i)), 1);
    }
    for (std::size_t k = 0; k < forced.size(); ++k) {
      const Part& p = parts_[std::size_t(forced[k])];
      const Index row = n + Index(k);
      const auto [R, e] = p.kind == 'D' ? line(p, mode_[std::size_t(forced[k])]) : std::pair(0.0, 0.0);  // v = R i + e
      const double unit = unit_of(R);
      at(P, p.a, row, unit), at(P, p.b, row, -unit), at(P, row, p.a, unit), at(P, row, p.b, -unit);
      P(row, row) = -R * unit * unit;
      if (p.kind == 'D') Q(row, states_) = e * unit;
      if (p.kind == 'C') Q(row, state_of(forced[k])) = 1;
      if (p.kind == 'V') set_source(forced[k], Q, row);
    }
    Eigen::FullPivLU<MatrixXl> lu(P);
    lu.setThreshold(1e-12);
    MatrixXl solved = lu.solve(Q);
    CircuitMode m = with_flows(forced, solved);
    if (lu.dimensionOfKernel() == 0) return m;
    // Nothing but inductors lead to some nodes, whose voltages keep the sum of these currents: K^T Q z' = 0.
    MatrixXl K = lu.kernel();
    K = (K.cwiseAbs().array() > 1e-12L * K.cwiseAbs().maxCoeff()).select(K, 0.0L).eval();
    const MatrixXl sums = K.transpose() * Q;
    const MatrixXl by_voltages = sums.leftCols(states_) * stored_.ldlt().solve(flows(forced, K));
    const MatrixXl change = by_voltages.partialPivLu().solve(sums * m.G.cast<long double>());
    solved -= K * change;
    m = with_flows(forced, solved);
    m.kept = sums.leftCols(states_).cast<double>();
    return m;
  }

  MatrixXl voltages(const MatrixXl& solved) const {
    MatrixXl v = MatrixXl::Zero(Index(parts_.size()), solved.cols());
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      if (parts_[i].a >= 0) v.row(Index(i)) += solved.row(parts_[i].a);
      if (parts_[i].b >= 0) v.row(Index(i)) -= solved.row(parts_[i].b);
    }
    return v;
  }

  // Currents of capacitors and voltages of inductors.
  MatrixXl flows(const std::vector<int>& forced, const MatrixXl& solved) const {
    const MatrixXl v = voltages(solved);
    MatrixXl flow(states_, solved.cols());
    for (Index k = 0; k < states_; ++k) {
      const int i = storage_[std::size_t(k)];
      const auto place = std::find(forced.begin(), forced.end(), i);
      if (place == forced.end())
        flow.row(k) = v.row(i);
      else
        flow.row(k) = solved.row(Index(net_.nodes.size()) + (place - forced.begin()));
    }
    return flow;
  }

  CircuitMode with_flows(const std::vector<int>& forced, const MatrixXl& solved) const {
    CircuitMode m{MatrixXd::Zero(width(), width()), MatrixXd::Zero(Index(parts_.size()), width()), {}, {}};
    for (std::size_t k = 0; k < forced.size(); ++k) {
      const Index i = forced[k];
      if (parts_[std::size_t(i)].kind != 'D') continue;
      const double unit = unit_of(line(parts_[std::size_t(i)], mode_[std::size_t(i)]).first);
      m.currents.row(i) = unit * solved.row(Index(net_.nodes.size()) + Index(k)).cast<double>();
    }
    m.G.topRows(states_) = stored_.ldlt().solve(flows(forced, solved)).cast<double>();
    for (std::size_t k = 0; k < sources_.size(); ++k) {
      const Index s = states_ + 1 + 2 * Index(k);
      const ReferenceSource& source = parts_[std::size_t(sources_[k])].source;
      m.G(s, s + 1) = source.pulses() ? 1 : source.w;
      if (!source.pulses()) m.G(s + 1, s) = -source.w;
    }
    return m;
  }

  // Of the unknown current of a part with this resistance, in A.
  static double unit_of(double R) { return R > 1 ? 1 / std::sqrt(R) : 1; }

  double conductance(const Part& p, int mode) const {
    const ReferenceModel& l = net_.models.at(p.model);
    return 1 / l.off + (mode > 0 ? 1 / l.on : 0);
  }

  // Of a diode, v = R i + e: R and e.
  std::pair<double, double> line(const Part& p, int mode) const {
    const ReferenceModel& l = net_.models.at(p.model);
    if (mode > 0) return {l.on, l.forward};
    if (mode == 0) return {l.off, 0};
    const double g = 1 / l.off + 1 / l.on_reverse;
    return {1 / g, -l.reverse / l.on_reverse / g};
  }

  Index state_of(int part) const { return std::find(storage_.begin(), storage_.end(), part) - storage_.begin(); }

  void set_source(int part, MatrixXl& Q, Index row) const {
    const ReferenceSource& s = parts_[std::size_t(part)].source;
    const Index k = states_ + 1 + 2 * (std::find(sources_.begin(), sources_.end(), part) - sources_.begin());
    Q(row, k) = s.pulses() ? 1 : s.amplitude;
    if (!s.pulses()) Q(row, states_) = s.offset;
  }

  /// At t, which lies `after` behind the begin of the piece.
  VectorXd z_at(double after) const {
    VectorXd z = VectorXd::Zero(width());
    z.head(states_) = x_;
    z[states_] = 1;
    for (std::size_t k = 0; k < sources_.size(); ++k) {
      const ReferenceSource& s = parts_[std::size_t(sources_[k])].source;
      double& first = z[states_ + 1 + 2 * Index(k)];
      double& second = z[states_ + 2 + 2 * Index(k)];
      if (s.pulses()) {
        const double span = end_ - begin_, middle = s.value(begin_ + span / 2);
        second = (s.value(begin_ + 0.75 * span) - s.value(begin_ + 0.25 * span)) / (0.5 * span);
        first = middle + second * (after - span / 2);
      } else {
        const double angle = s.w * (begin_ + after) + s.phase;
        first = std::sin(angle), second = std::cos(angle);
      }
    }
    return z;
  }

  // Whether the current of a diode, up to rounding, does not fit where it is: then where it belongs, -1, 0 or 1.
  bool is_wrong(std::size_t i, const CircuitMode& m, const VectorXd& z, const VectorXd& terms, int& right) const {
    const ReferenceModel& l = net_.models.at(parts_[i].model);
    const double on = l.forward / (l.off - l.on), back = -l.reverse / l.off, now = m.currents.row(Index(i)).dot(z),
                 least = zero_share * (m.currents.row(Index(i)).cwiseAbs().dot(terms) + on);
    right = now > on ? 1 : now < back ? -1 : 0;
    if (mode_[i] > 0) return on - now > least;
    if (mode_[i] < 0) return now - back > least;
    return now - on > least || back - now > least;
  }

  bool any_wrong(const CircuitMode& m, const VectorXd& z, const VectorXd& terms, std::size_t& which, int& right) const {
    for (which = 0; which < parts_.size(); ++which)
      if (parts_[which].kind == 'D' && is_wrong(which, m, z, terms, right)) return true;
    return false;
  }

  // Takes what rounding has left in the sums of currents, by an impulse of voltage.
  void keep_sums() {
    const MatrixXd S = mode().kept;
    if (S.rows() == 0) return;
    const MatrixXd by = stored_.cast<double>().ldlt().solve(S.transpose());
    x_ -= by * (S * by).ldlt().solve(S * x_);
  }

  // Least index first (Murty): ends where the network of resistances has one solution.
  void settle(const VectorXd& z) {
    std::size_t which = 0;
    for (int k = 0, right = 0; any_wrong(mode(), z, z.cwiseAbs(), which, right); ++k) {
      if (k == 10000 || changes_ == most_changes) throw std::runtime_error("no mode fits");
      mode_[which] = right, ++changes_;
    }
  }

  // Steps halve until one ends before the first change of mode; the shortest step contains it. Where two halves show
  // none, because rounding moves the state as much as they do, that of the whole is taken behind them. Behind a change
  // they grow from the shortest: a diode may conduct for a part of a fast transient alone.
  void advance(double begin, double end) {
    begin_ = begin, end_ = end;
    for (std::size_t i = 0; i < parts_.size(); ++i)
      if (parts_[i].kind == 'S') mode_[i] = control(parts_[i], (begin + end) / 2) > 0;
    VectorXd z = settled(0);
    int least_level = 0, first_level = levels - 1, halves = 0, right = 0;
    std::size_t blamed = 0;
    for (double t = 0, span = end - begin;;) {
      int level = std::max(least_level, first_level);
      while (level < levels && std::ldexp(longest_, -level) > std::min(span - t, span / 6)) ++level;
      if (level == levels) break;
      const MatrixXd& step = mode().step[std::size_t(level)];
      const VectorXd next = step * z, terms = step.cwiseAbs() * z.cwiseAbs();
      std::size_t which = 0;
      int where = 0;
      const bool wrong = any_wrong(mode(), next, terms, which, where);
      if (wrong) blamed = which, right = where;
      if (wrong && level + 1 < levels) {
        least_level = level + 1, halves = 0;
        continue;
      }
      z = next, t += std::ldexp(longest_, -level);
      x_ = z.head(states_);
      largest_ = largest_.cwiseMax(x_.cwiseAbs());
      first_level = std::max(0, first_level - 1);
      if (!wrong && (least_level == 0 || level > least_level || ++halves < 2)) continue;
      least_level = halves = 0, first_level = levels - 1;
      if (!wrong) mode_[blamed] = right, ++changes_;
      z = settled(t);
    }
  }

  VectorXd settled(double after) {
    keep_sums();
    const VectorXd z = z_at(after);
    settle(z);
    return z;
  }

  const ReferenceNetlist net_;
  const std::vector<Part>& parts_;
  std::vector<int> storage_, sources_, mode_;
  std::map<std::vector<int>, CircuitMode> modes_;
  Index states_ = 0;
  MatrixXl stored_;
  double longest_ = 0, begin_ = 0, end_ = 0;
  VectorXd x_, largest_;
  long changes_ = 0;
};

}  // namespace

ReferenceValues mode_by_mode(const std::string& netlist, const std::vector<double>& times) {
  return Simulation(netlist).run(times);
}

}  // namespace bromwich::test
