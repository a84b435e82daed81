#include "mpi/mpi_job.hpp"

#include <mpi.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <thread>

namespace bromwich {

namespace {

constexpr Index most_together = Index(1) << 28;  ///< values of a message: MPI counts with int

int rank_in(MPI_Comm ranks) {
  int rank = 0;
  MPI_Comm_rank(ranks, &rank);
  return rank;
}
int size_of(MPI_Comm ranks) {
  int size = 1;
  MPI_Comm_size(ranks, &size);
  return size;
}

class MpiCommunicator final : public Communicator {
 public:
  explicit MpiCommunicator(MPI_Comm ranks) : Communicator(rank_in(ranks), size_of(ranks)), ranks_(ranks) {}

 private:
  void do_shift(const Vector& right, Vector& left) override {
    const int to = rank() + 1 < size() ? rank() + 1 : MPI_PROC_NULL, from = rank() > 0 ? rank() - 1 : MPI_PROC_NULL;
    // The lengths of both are the same on all ranks that take part.
    const Index count = std::max(to == MPI_PROC_NULL ? 0 : right.size(), from == MPI_PROC_NULL ? 0 : left.size());
    for (Index begin = 0; begin < count; begin += most_together) {
      const int sent = to == MPI_PROC_NULL ? 0 : length(begin, right.size()),
                received = from == MPI_PROC_NULL ? 0 : length(begin, left.size());
      MPI_Sendrecv(right.data() + begin, sent, MPI_DOUBLE, to, 0, left.data() + begin, received, MPI_DOUBLE, from, 0,
                   ranks_, MPI_STATUS_IGNORE);
    }
  }
  void do_gather(const Vector& values, RowMatrix& all) override {
    const int count = int(values.size());  // few, by contract
    MPI_Allgather(values.data(), count, MPI_DOUBLE, all.data(), count, MPI_DOUBLE, ranks_);
  }
  void do_maximum(Vector& values) override {
    MPI_Allreduce(MPI_IN_PLACE, values.data(), int(values.size()), MPI_DOUBLE, MPI_MAX, ranks_);
  }
  void do_broadcast(double* values, Index count, int root) override {
    for (Index begin = 0; begin < count; begin += most_together)
      MPI_Bcast(values + begin, length(begin, count), MPI_DOUBLE, root, ranks_);
  }

  static int length(Index begin, Index count) { return int(std::clamp<Index>(count - begin, 0, most_together)); }

  MPI_Comm ranks_;
};

class JobOfMpi final : public MpiJob {
 public:
  explicit JobOfMpi(MPI_Comm all) : communicator_(all) {
    MPI_Comm_dup(all, &at_the_end_);
    MPI_Comm here;
    MPI_Comm_split_type(all, MPI_COMM_TYPE_SHARED, communicator_.rank(), MPI_INFO_NULL, &here);
    neighbours_ = size_of(here);
    number_here_ = rank_in(here);
    MPI_Comm_free(&here);
    const MPI_Aint bytes = communicator_.rank() == 0 ? MPI_Aint(sizeof(long)) : 0;
    MPI_Win_allocate(bytes, sizeof(long), MPI_INFO_NULL, all, &number_, &window_);
    if (communicator_.rank() == 0) *number_ = 0;
    MPI_Barrier(all);
  }

  ~JobOfMpi() override {
    MPI_Win_free(&window_);
    MPI_Comm_free(&at_the_end_);
    MPI_Finalize();
  }

  Communicator& communicator() override { return communicator_; }
  int neighbours() const override { return neighbours_; }
  int number_here() const override { return number_here_; }

  Index next_number() override {
    const long one = 1;
    long mine = 0;
    MPI_Win_lock(MPI_LOCK_SHARED, 0, 0, window_);
    MPI_Fetch_and_op(&one, &mine, MPI_LONG, 0, 0, MPI_SUM, window_);
    MPI_Win_unlock(0, window_);
    return Index(mine);
  }

  void restart_numbers() override {
    MPI_Barrier(MPI_COMM_WORLD);
    if (communicator_.rank() == 0) {
      MPI_Win_lock(MPI_LOCK_EXCLUSIVE, 0, 0, window_);
      *number_ = 0;
      MPI_Win_unlock(0, window_);
    }
    MPI_Barrier(MPI_COMM_WORLD);
  }

  bool all_arrive(double seconds) override {
    MPI_Request request;
    MPI_Ibarrier(at_the_end_, &request);
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    for (int arrived = 0;;) {
      MPI_Test(&request, &arrived, MPI_STATUS_IGNORE);
      if (arrived) return true;
      if (std::chrono::steady_clock::now() > end) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  }

  void abort(int code) override {
    MPI_Abort(MPI_COMM_WORLD, code);
    std::_Exit(code);
  }

 private:
  MpiCommunicator communicator_;
  MPI_Comm at_the_end_ = MPI_COMM_NULL;  ///< of all_arrive alone
  int neighbours_ = 1, number_here_ = 0;
  long* number_ = nullptr;  ///< the next one, in memory of rank 0
  MPI_Win window_ = MPI_WIN_NULL;
};

}  // namespace

std::unique_ptr<MpiJob> join_mpi(int& argc, char**& argv) {
  MPI_Init(&argc, &argv);
  return std::make_unique<JobOfMpi>(MPI_COMM_WORLD);
}

}  // namespace bromwich
