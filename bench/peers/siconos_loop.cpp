// One Siconos simulation of x' = A x + B y + f, 0 <= y ⊥ w = N x + M y + g >= 0, by a Moreau time-stepping scheme with
// an LCP a step; built and started by scripts/bench_peers. Reads a problem, writes y and the observed components of x
// at all steps, prints {"setup": s, "loop": s, "first": s, "failures": k, "steps": j}; "first": of the first step.
//
//   siconos_loop PROBLEM RESULT dense|sparse step|once THETA [SECONDS]
//
// dense|sparse  storage of A and of the iteration matrix I - h theta A
// step|once     how often that matrix is factorised and the matrix of the LCP formed: step is the default of
//               TimeStepping; for once see FactorisedOnce and keep_lcp_matrix
// THETA         theta and gamma of EulerMoreauOSI; 1 is the implicit Euler method
// SECONDS       no step begins later than this after the first; the result has the steps done
//
// here          Siconos                    file, all entries double, matrices by rows
// m, n, J       -                          m, n, nonzeros of A, J, observed components of x, h
// A, B          A, B (r = B lambda)        (row, column, value)..., m x n
// N, M          C, D                       n x m, n x n
// x0, r0        x0, r before step 1        m, m
// observed      -                          indices of x
// f, g          b, e                       J x m, J x n: the values for step 1, ..., J
// y, w          lambda, y                  result: J x (y, observed x)
#include <lcp_cst.h>
#include <SiconosKernel.hpp>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

using Clock = std::chrono::steady_clock;
using MatrixPointer = std::shared_ptr<SimpleMatrix>;
using VectorPointer = std::shared_ptr<SiconosVector>;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

/// In TimeStepping the integrator forms I - h theta A at every step and discards its factors. For a time-invariant
/// system on a uniform grid this matrix is always the same: that of the first step is kept.
class FactorisedOnce : public EulerMoreauOSI {
 public:
  using EulerMoreauOSI::EulerMoreauOSI;
  void prepareNewtonIteration(double time) override {
    if (!prepared_) EulerMoreauOSI::prepareNewtonIteration(time);
    prepared_ = true;
  }

 private:
  bool prepared_ = false;
};

/// Reads the doubles of a file in order.
class Reader {
 public:
  explicit Reader(const char* path) {
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    values_.resize(std::size_t(file.tellg()) / sizeof(double));
    file.seekg(0);
    file.read(reinterpret_cast<char*>(values_.data()), std::streamsize(values_.size() * sizeof(double)));
  }
  double number() { return values_.at(next_++); }
  unsigned index() { return unsigned(number()); }
  std::vector<double> block(std::size_t size) {
    next_ += size;
    if (next_ > values_.size()) throw std::out_of_range("the problem file is too short");
    return {values_.begin() + std::ptrdiff_t(next_ - size), values_.begin() + std::ptrdiff_t(next_)};
  }
  MatrixPointer matrix(unsigned rows, unsigned columns) {
    const auto result = std::make_shared<SimpleMatrix>(rows, columns);
    for (unsigned i = 0; i < rows; ++i)
      for (unsigned j = 0; j < columns; ++j) result->setValue(i, j, number());
    return result;
  }
  VectorPointer vector(unsigned size) {
    const auto result = std::make_shared<SiconosVector>(size);
    for (unsigned i = 0; i < size; ++i) (*result)(i) = number();
    return result;
  }

 private:
  std::vector<double> values_;
  std::size_t next_ = 0;
};

MatrixPointer square_matrix(unsigned size, bool sparse) {
  const auto result = std::make_shared<SimpleMatrix>(size, size, sparse ? Siconos::SPARSE : Siconos::DENSE);
  result->zero();
  return result;
}

/// LinearOSNS forms the matrix of the LCP, n solves and a product, until it is told that nothing has changed.
void keep_lcp_matrix(LCP& lcp, NonSmoothDynamicalSystem& model) {
  model.topology()->setHasChanged(false);
  lcp.setHasBeenUpdated(true);
}

int failures = 0;

void count_failures(int info, Simulation*) {
  if (info != 0) ++failures;
}

struct Problem {
  Problem(Reader file, bool sparse)
      : m(file.index()),
        n(file.index()),
        nonzeros(file.index()),
        J(file.index()),
        observed(file.index()),
        h(file.number()),
        A(square_matrix(m, sparse)) {
    for (unsigned k = 0; k < nonzeros; ++k) {
      const unsigned row = file.index(), column = file.index();
      A->setValue(row, column, file.number());
    }
    B = file.matrix(m, n);
    N = file.matrix(n, m);
    M = file.matrix(n, n);
    x0 = file.vector(m);
    r0 = file.vector(m);
    components = file.block(observed);
    f = file.block(std::size_t(J) * m);
    g = file.block(std::size_t(J) * n);
  }

  unsigned m, n, nonzeros, J, observed;
  double h;
  MatrixPointer A, B, N, M;
  VectorPointer x0, r0;
  std::vector<double> components, f, g;
};

struct Model {
  VectorPointer b, e;
  std::shared_ptr<FirstOrderLinearTIDS> system;
  std::shared_ptr<Interaction> interaction;
  std::shared_ptr<NonSmoothDynamicalSystem> whole;
  std::shared_ptr<LCP> lcp;
  std::shared_ptr<TimeStepping> simulation;
};

Model build(const Problem& problem, bool sparse, bool once, double theta) {
  Model model;
  model.b = std::make_shared<SiconosVector>(problem.m);
  model.e = std::make_shared<SiconosVector>(problem.n);
  model.system = std::make_shared<FirstOrderLinearTIDS>(problem.x0, problem.A, model.b);
  if (sparse) {  // the iteration matrix has the storage of the mass matrix
    const auto identity = square_matrix(problem.m, true);
    for (unsigned i = 0; i < problem.m; ++i) identity->setValue(i, i, 1);
    model.system->setMPtr(identity);
  }
  *model.system->r() = *problem.r0;  // used by the first step if theta < 1; with 0 one order would be lost
  const auto relation = std::make_shared<FirstOrderLinearTIR>(problem.N, problem.B);
  relation->setDPtr(problem.M);
  relation->setePtr(model.e);
  model.interaction = std::make_shared<Interaction>(std::make_shared<ComplementarityConditionNSL>(problem.n), relation);
  model.whole = std::make_shared<NonSmoothDynamicalSystem>(0., problem.J * problem.h);
  model.whole->insertDynamicalSystem(model.system);
  model.whole->link(model.interaction, model.system);

  const auto integrator = once ? std::make_shared<FactorisedOnce>(theta) : std::make_shared<EulerMoreauOSI>(theta);
  if (theta < 1) integrator->setGamma(theta);
  model.lcp = std::make_shared<LCP>(SICONOS_LCP_LEMKE);
  const auto grid = std::make_shared<TimeDiscretisation>(0., problem.h);
  model.simulation = std::make_shared<TimeStepping>(model.whole, grid, integrator, model.lcp);
  model.simulation->setNewtonOptions(SICONOS_TS_LINEAR);
  model.simulation->setCheckSolverFunction(count_failures);
  model.simulation->initialize();
  return model;
}

/// y and the observed components of x at all steps that begin within `limit` seconds; `first`: seconds of the first
/// one.
std::vector<double> advance(Model& model, const Problem& problem, bool once, double limit, double& first) {
  const unsigned m = problem.m, n = problem.n;
  const SiconosVector &y = *model.interaction->lambda(0), &x = *model.system->x();
  std::vector<double> result;
  result.reserve(std::size_t(problem.J) * (n + problem.observed));
  const auto start = Clock::now();
  for (std::size_t j = 0; j < problem.J && seconds_since(start) <= limit; ++j) {
    for (unsigned i = 0; i < m; ++i) (*model.b)(i) = problem.f[j * m + i];
    for (unsigned i = 0; i < n; ++i) (*model.e)(i) = problem.g[j * n + i];
    model.simulation->computeOneStep();
    for (unsigned i = 0; i < n; ++i) result.push_back(y(i));
    for (const double component : problem.components) result.push_back(x(unsigned(component)));
    model.simulation->nextStep();
    if (once) keep_lcp_matrix(*model.lcp, *model.whole);
    if (j == 0) first = seconds_since(start);
  }
  return result;
}

void run(int count, char** arguments) {
  const bool sparse = arguments[3] == std::string("sparse"), once = arguments[4] == std::string("once");
  const Problem problem(Reader(arguments[1]), sparse);

  const auto setup = Clock::now();
  Model model = build(problem, sparse, once, std::atof(arguments[5]));
  const double setup_seconds = seconds_since(setup);

  const auto loop = Clock::now();
  double first = 0;
  const double limit = count > 6 ? std::atof(arguments[6]) : std::numeric_limits<double>::infinity();
  const std::vector<double> result = advance(model, problem, once, limit, first);
  const double loop_seconds = seconds_since(loop);

  std::ofstream(arguments[2], std::ios::binary)
      .write(reinterpret_cast<const char*>(result.data()), std::streamsize(result.size() * sizeof(double)));
  std::printf("\n{\"setup\": %.9g, \"loop\": %.9g, \"first\": %.9g, \"failures\": %d, \"steps\": %zu}\n", setup_seconds,
              loop_seconds, first, failures, result.size() / (problem.n + problem.observed));
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 6 && count != 7) {
    std::fprintf(stderr, "siconos_loop PROBLEM RESULT dense|sparse step|once THETA [SECONDS]\n");
    return 2;
  }
  try {
    run(count, arguments);
  } catch (...) {
    Siconos::exception::process();
    return 1;
  }
  return 0;
}
