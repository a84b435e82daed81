// Files of results: what is written in blocks of any size is read back by the HDF5 library, also while it is written.

#include "core/base/error.hpp"
#include "files/checkpoint.hpp"
#include "files/result_file.hpp"
#include "files/stored_result.hpp"
#include "files/sweep_file.hpp"
#include "tests/files/hdf5_reading.hpp"
#include "tests/support/archive.hpp"

#include <hdf5_hl.h>
#include <unistd.h>

#include <array>
#include <fstream>
#include <numeric>
#include <random>

namespace bromwich {
namespace {

namespace fs = std::filesystem;

class ResultFileTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("bromwich_files_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  FileTarget target(const std::string& name) const { return {"--out", folder_ / name}; }

  fs::path folder_;
};

struct Values {
  Vector t;
  RowMatrix y, w, x;
  Index first = 0;
  ResultRows rows(Index count) {
    const Index at = std::exchange(first, first + count);
    return {t.segment(at, count), y.middleRows(at, count), w.middleRows(at, count), x.middleRows(at, count)};
  }
};

Values values(Index rows, Index n, Index k) {
  std::srand(1);
  return {Vector::LinSpaced(rows, 0, 1), RowMatrix::Random(rows, n), RowMatrix::Random(rows, n),
          RowMatrix::Random(rows, k)};
}

ResultColumns columns(Index n, std::vector<Index> states) {
  ResultColumns made;
  made.constraints = n;
  made.slack = true;
  made.states = std::move(states);
  made.y_unit = "A";
  return made;
}

const Facts facts{{"status", "running"}, {"run", "r1"}, {"steps", std::int64_t(7)}, {"T", 2.5}};

// 100 columns have chunks of 1310 rows: blocks end inside of chunks, at their ends and beyond.
TEST_F(ResultFileTest, BlocksOfAnySize) {
  const Index rows = 5000, n = 100;
  for (const std::vector<Index>& sizes :
       {std::vector<Index>{5000}, {1, 1309, 1310, 1311, 1069}, {1310, 2620, 1, 1069}, {2621, 2379}}) {
    Values given = values(rows, n, 3);
    const auto file = create_hdf5(target("r.h5"), columns(n, {4, 7, 9}), rows, facts);
    for (const Index size : sizes) file->append(given.rows(size));
    EXPECT_EQ(file->rows(), rows);
    file->set({{"status", "solved"}, {"residual", 1e-15}});
    const Hdf5Reading read(folder_ / "r.h5");  // it is still open for writing
    EXPECT_EQ(read.rows("t"), given.t);
    EXPECT_EQ(read.rows("y"), given.y);
    EXPECT_EQ(read.rows("w"), given.w);
    EXPECT_EQ(read.rows("x"), given.x);
    EXPECT_EQ(read.rows("state"), (RowMatrix(3, 1) << 4, 7, 9).finished());
    EXPECT_EQ(read.text("status"), "solved");
    EXPECT_EQ(read.number("/", "steps"), 7);
    EXPECT_EQ(read.number("/", "residual"), 1e-15);
  }
}

TEST_F(ResultFileTest, RowsOfWholeChunksAndOfFlushesAreThere) {
  Values given = values(3000, 100, 0);
  const auto file = create_hdf5(target("r.h5"), columns(100, {}), 3000, facts);
  file->append(given.rows(1500));
  EXPECT_EQ(Hdf5Reading(folder_ / "r.h5").shape("y")[0], 1310u);
  file->flush();
  EXPECT_EQ(Hdf5Reading(folder_ / "r.h5").rows("y"), given.y.topRows(1500));
  EXPECT_FALSE(Hdf5Reading(folder_ / "r.h5").has("x"));
}

// As a run leaves them that is killed within a flush: sizes are there, and values of the last rows are not.
TEST_F(ResultFileTest, RowsWithoutValuesOfARunThatWasKilledAreNotRead) {
  Values given = values(50, 4, 2);
  given.y.bottomRows(3).setConstant(NAN);
  given.x(20, 1) = NAN;
  const auto file = create_hdf5(target("r.h5"), columns(4, {0, 1}), 50, facts);
  file->append(given.rows(50));
  file->flush();
  const StoredResult killed = read_hdf5(target("r.h5"));
  EXPECT_EQ(killed.t, given.t.head(47));
  EXPECT_EQ(killed.y, given.y.topRows(47));
  EXPECT_EQ(killed.w, given.w.topRows(47));
  EXPECT_EQ(killed.x.rows(), 47);
  file->set({{"status", "interrupted"}});
  EXPECT_EQ(read_hdf5(target("r.h5")).t, given.t) << "a run that ended says itself which rows have no values";
}

// Rows wider than a chunk.
TEST_F(ResultFileTest, WideRows) {
  const Index k = 200003;
  std::vector<Index> states;
  for (Index i = 0; i < k; ++i) states.push_back(i);
  Values given = values(3, 1, k);
  const auto file = create_hdf5(target("r.h5"), columns(1, states), 3, facts);
  file->append(given.rows(2));
  file->append(given.rows(1));
  EXPECT_EQ(Hdf5Reading(folder_ / "r.h5").rows("x"), given.x);
}

TEST_F(ResultFileTest, DimensionScales) {
  Values given = values(4, 2, 1);
  create_hdf5(target("r.h5"), columns(2, {5}), 4, facts)->append(given.rows(4));
  const hid_t file = H5Fopen((folder_ / "r.h5").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  const hid_t y = H5Dopen2(file, "y", H5P_DEFAULT);
  for (const auto& [axis, name] : {std::pair(0u, "t"), {1u, "constraint"}}) {
    const hid_t scale = H5Dopen2(file, name, H5P_DEFAULT);
    EXPECT_GT(H5DSis_scale(scale), 0) << name;
    EXPECT_GT(H5DSis_attached(y, scale, axis), 0) << name;
    H5Dclose(scale);
  }
  H5Dclose(y);
  H5Fclose(file);
}

TEST_F(ResultFileTest, ContinuedAfterSomeRows) {
  const ResultColumns wanted = columns(100, {0});
  Values given = values(3000, 100, 1);
  {
    const auto file = create_hdf5(target("r.h5"), wanted, 3000, facts);
    file->append(given.rows(2000));
    file->flush();
  }
  const auto refused = [&](const ResultColumns& other, Index rows, const std::string& run, const std::string& word) {
    try {
      continue_hdf5(target("r.h5"), other, rows, run);
      ADD_FAILURE() << word;
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
    }
  };
  refused(wanted, 2001, "r1", "has 2000 rows");
  refused(wanted, 10, "r2", "not of the run");
  refused(columns(99, {0}), 10, "r1", "other columns of y");
  refused(columns(100, {}), 10, "r1", "other columns of x");
  given.first = 1400;
  const auto file = continue_hdf5(target("r.h5"), wanted, 1400, "r1");
  EXPECT_EQ(Hdf5Reading(folder_ / "r.h5").shape("y")[0], 1400u);
  file->append(given.rows(1600));
  file->flush();
  EXPECT_EQ(Hdf5Reading(folder_ / "r.h5").rows("y"), given.y);
  EXPECT_EQ(Hdf5Reading(folder_ / "r.h5").rows("x"), given.x);
}

TEST_F(ResultFileTest, OneWriterAtATime) {
  const auto file = create_hdf5(target("r.h5"), columns(1, {}), 4, facts);
  try {
    create_hdf5(target("r.h5"), columns(1, {}), 4, facts);
    ADD_FAILURE();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("by another process"), std::string::npos) << error.what();
  }
}

// y and w of constraint i on line i; x as it is: state index = line * across + position.
TEST_F(ResultFileTest, FieldsOnAGrid) {
  const FieldGrid grid{3, 4, 0.25, 0.2};
  std::vector<Index> states;
  for (Index i = 0; i < 12; ++i) states.push_back(i);
  Values given = values(6, 3, 12);
  const auto file = create_vtkhdf(target("r.vtkhdf"), grid, columns(3, states), 6, facts);
  file->append(given.rows(2));
  file->append(given.rows(4));
  file->flush();
  const Hdf5Reading read(folder_ / "r.vtkhdf");
  EXPECT_EQ(read.number("VTKHDF/Steps", "NSteps"), 6);
  EXPECT_EQ(read.rows("VTKHDF/Steps/Values"), given.t);
  EXPECT_EQ(read.shape("VTKHDF/PointData/x"), (std::vector<hsize_t>{6, 3, 4}));
  EXPECT_EQ(read.rows("VTKHDF/PointData/x"), given.x);
  const RowMatrix y = read.rows("VTKHDF/PointData/y");
  for (Index i = 0; i < 12; ++i) EXPECT_EQ(y.col(i), given.y.col(i / 4)) << i;
  EXPECT_EQ(read.rows("VTKHDF/Steps/PointDataOffsets/y"), (RowMatrix(6, 1) << 0, 1, 2, 3, 4, 5).finished());
  EXPECT_THROW(create_vtkhdf(target("s.vtkhdf"), grid, columns(3, {0, 1}), 6, facts), Error);
  EXPECT_THROW(create_vtkhdf(target("s.vtkhdf"), grid, columns(2, {}), 6, facts), Error);
}

// Constraints on two sides of a grid of 2 lines: each on the half of the line next to it.
TEST_F(ResultFileTest, FieldsWithConstraintsOnTwoSides) {
  const FieldGrid grid{2, 3, 0.25, 0.2, 0.125, 0.2};
  Values given = values(2, 4, 6);
  const auto file = create_vtkhdf(target("r.vtkhdf"), grid, columns(4, {0, 1, 2, 3, 4, 5}), 2, facts);
  file->append(given.rows(2));
  file->flush();
  const Hdf5Reading read(folder_ / "r.vtkhdf");
  const RowMatrix y = read.rows("VTKHDF/PointData/y");
  const Index constraint[] = {0, 0, 2, 1, 1, 3};
  for (Index i = 0; i < 6; ++i) EXPECT_EQ(y.col(i), given.y.col(constraint[i]).head(2)) << i;
  // Read again it is what was given, of both sides.
  const StoredResult stored = read_hdf5(target("r.vtkhdf"));
  EXPECT_EQ(stored.t, given.t.head(2));
  EXPECT_EQ(stored.y, given.y.topRows(2));
  EXPECT_EQ(stored.x, given.x.topRows(2));
  EXPECT_EQ(stored.constraint_names, (std::vector<std::string>{"y0", "y1", "y2", "y3"}));
}

TEST_F(ResultFileTest, Checkpoints) {
  const Checkpoint written{"run",           "scene of 3",      12, 40, 0.3, Vector::LinSpaced(5, 0, 1.0 / 3),
                           Vector::Zero(0), {{"seconds", 1.5}}};
  for (int i = 0; i < 2; ++i) write_checkpoint(target("c.h5"), written);
  const Checkpoint found = read_checkpoint(target("c.h5"));
  EXPECT_EQ(found.run, "run");
  EXPECT_EQ(found.scene, "scene of 3");
  EXPECT_EQ(found.row, 12);
  EXPECT_EQ(found.steps, 40);
  EXPECT_EQ(found.t, 0.3);
  EXPECT_EQ(found.x, written.x);
  EXPECT_EQ(found.y.size(), 0);
  EXPECT_EQ(found.totals, written.totals);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator{}), 1);

  std::ofstream(folder_ / "text.h5") << "no HDF5";
  EXPECT_THROW(read_checkpoint(target("text.h5")), Error);
  create_hdf5(target("r.h5"), columns(1, {}), 4, facts);
  EXPECT_THROW(read_checkpoint(target("r.h5")), Error);
}

// Damaged bytes end in an Error or in values, never in a crash.
TEST_F(ResultFileTest, DamagedCheckpoints) {
  write_checkpoint(target("c.h5"), {"run", "scene", 1, 2, 0.5, Vector::Ones(3), Vector::Ones(1), {}});
  std::ifstream stream(folder_ / "c.h5", std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(stream), {}};
  std::mt19937 random(3);
  for (int trial = 0; trial < 200; ++trial) {
    std::string damaged = bytes;
    for (int i = 0; i < 3; ++i) damaged[random() % damaged.size()] = char(random());
    if (trial % 4 == 0) damaged.resize(random() % damaged.size());
    std::ofstream(folder_ / "d.h5", std::ios::binary) << damaged;
    try {
      read_checkpoint(target("d.h5"));
    } catch (const Error&) {
    }
  }
}

std::string bytes_of(const fs::path& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

/// The message of an Error, or "" where there is none.
template <class Read>
std::string refusal(Read&& read) {
  try {
    read();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

/// An array of NumPy whose header says this of its type and its shape.
std::string numpy_array(const std::string& type, const std::string& shape, const std::string& bytes) {
  const std::string header = "{'descr': '" + type + "', 'fortran_order': False, 'shape': (" + shape + "), }\n";
  return std::string("\x93NUMPY\x01\x00", 8) + char(header.size()) + '\0' + header + bytes;
}

// A file that claims more than it holds is refused before memory is taken for it.
TEST_F(ResultFileTest, ArchivesThatClaimMore) {
  const std::string three(24, '\0');
  const auto refused = [&](const std::string& t, const std::string& names) {
    write_archive(folder_ / "d.npz", {{"t", t}, {"constraint_name", names}});
    return refusal([&] { read_npz(target("d.npz")); });
  };
  const std::string right = numpy_array("<f8", "3,", three),
                    names = numpy_array("<U1", "1,", std::string("a\0\0\0", 4));
  EXPECT_EQ(refused(right, names), "");
  EXPECT_EQ(read_npz(target("d.npz")).t.size(), 3);
  for (const char* shape :
       {"4,", "3, 0", "1000000000000,", "99999999999999999999,", "4294967296, 4294967296", "-3,", "three,"})
    EXPECT_NE(refused(numpy_array("<f8", shape, three), names), "") << shape;
  for (const char* type : {"<U", "<U9", "<U9999999999", "<U-1", "<Ux"})  // names that are no names are left out
    EXPECT_EQ(refused(right, numpy_array(type, "1,", std::string("a\0\0\0", 4))), "") << type;
  EXPECT_NE(refused(right, "\x93NUMPY"), "");
  EXPECT_NE(refused(right.substr(0, 20), names), "");
}

TEST_F(ResultFileTest, DatasetsThatClaimMore) {
  {
    Values all = values(4, 2, 1);
    const auto file = create_hdf5(target("r.h5"), columns(2, {0}), 4, facts);
    file->append(all.rows(4));
  }
  const hid_t file = H5Fopen((folder_ / "r.h5").c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t y = H5Dopen2(file, "y", H5P_DEFAULT);
  const std::array<hsize_t, 2> huge{hsize_t(1) << 40, 2};
  EXPECT_GE(H5Dset_extent(y, huge.data()), 0);
  H5Dclose(y);
  H5Fclose(file);
  EXPECT_NE(refusal([&] { read_hdf5(target("r.h5")); }).find("larger than the file can hold"), std::string::npos);

  const std::string bytes = bytes_of(folder_ / "r.h5");
  std::mt19937 random(5);
  for (int trial = 0; trial < 200; ++trial) {
    std::string damaged = bytes;
    for (int i = 0; i < 3; ++i) damaged[random() % damaged.size()] = char(random());
    std::ofstream(folder_ / "d.h5", std::ios::binary) << damaged;
    refusal([&] { read_hdf5(target("d.h5")); });
  }
}

// Chunks of whole scenes are compressed by this program, those of a part of a scene by the library: both are read by
// it.
TEST_F(ResultFileTest, SweepsInBlocksOfAnySize) {
  for (const auto& [rows, blocks] :
       {std::pair(Index(257), std::vector<Index>{1, 40, 29, 62, 3}), {Index(40'000), std::vector<Index>{1, 1}}}) {
    const Index n = 4, scenes = std::accumulate(blocks.begin(), blocks.end(), Index(0));
    const RowMatrix parameters = RowMatrix::Random(scenes, 1), y = RowMatrix::Random(scenes * rows, n),
                    w = RowMatrix::Random(scenes * rows, n), x = RowMatrix::Random(scenes * rows, 2);
    const Vector residual = Vector::Random(scenes);
    ResultColumns of_sweep = columns(n, {0, 3});
    of_sweep.slack = true;
    const Sweep sweep{{"R"}, parameters, {}};
    const FileTarget to = target("sweep.h5");
    {
      const auto file = create_sweep_hdf5(to, of_sweep, sweep, Vector::LinSpaced(rows, 0, 1));
      Index first = 0;
      for (const Index count : blocks) {
        file->append({parameters.middleRows(first, count), residual.segment(first, count),
                      y.middleRows(first * rows, count * rows), w.middleRows(first * rows, count * rows),
                      x.middleRows(first * rows, count * rows)},
                     HostThreads());
        first += count;
      }
      const std::vector<std::string> words(std::size_t(scenes), "solved");
      file->finish(words, words, words, {});
    }
    const Hdf5Reading found(to.path);
    for (const auto& [name, values] : {std::pair("y", &y), {"w", &w}, {"x", &x}}) {
      ASSERT_EQ(found.shape(name), (std::vector<hsize_t>{hsize_t(scenes), hsize_t(rows), hsize_t(values->cols())}));
      const RowMatrix all = found.rows(name);
      EXPECT_TRUE(Eigen::Map<const Vector>(all.data(), all.size()) ==
                  Eigen::Map<const Vector>(values->data(), values->size()))
          << name;
    }
    EXPECT_TRUE(found.rows("R") == parameters);
    EXPECT_TRUE(found.rows("residual").col(0) == residual);
  }
}

}  // namespace
}  // namespace bromwich
