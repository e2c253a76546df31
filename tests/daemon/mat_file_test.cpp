#include "daemon/export/mat_file.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <array>
#include <csignal>
#include <memory>
#include <stdexcept>
#include <vector>

#include "recording_rig.hpp"

namespace isorig::daemon::testing {
namespace {

constexpr std::size_t kColumns = 6, kRows = 5'000;

struct Free {
  void operator()(matvar_t* v) const noexcept { Mat_VarFree(v); }
};
using Variable = std::unique_ptr<matvar_t, Free>;

/// As a stream of an export is: a struct of columns, 240,560 bytes in a plain file.
Variable columns() {
  std::array<const char*, kColumns> names{"a", "b", "c", "d", "e", "f"};
  std::array<std::size_t, 2> one{1, 1}, dims{kRows, 1};
  Variable out(Mat_VarCreateStruct("frame", 2, one.data(), names.data(), kColumns));
  std::vector<double> values(kRows);
  for (std::size_t c = 0; c < kColumns; ++c) {
    for (std::size_t i = 0; i < kRows; ++i) values[i] = static_cast<double>(c * kRows + i);
    Mat_VarSetStructFieldByIndex(out.get(), c, 0,
                                 Mat_VarCreate(names[c], MAT_C_DOUBLE, MAT_T_DOUBLE, 2, dims.data(), values.data(), 0));
  }
  return out;
}

/// No file of this process grows beyond it, as on a disk that is full.
class FileLimit {
 public:
  explicit FileLimit(rlim_t bytes) {
    std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before_);
    rlimit now = before_;
    now.rlim_cur = bytes;
    setrlimit(RLIMIT_FSIZE, &now);
  }
  ~FileLimit() { setrlimit(RLIMIT_FSIZE, &before_); }
  FileLimit(const FileLimit&) = delete;
  FileLimit& operator=(const FileLimit&) = delete;

 private:
  rlimit before_{};
};

TEST(MatFile, IsReadBackByLibmatio) {
  const TemporaryDirectory dir("mat");
  const auto path = dir.path() / "whole.mat";
  MatFile file(path);
  const Variable written = columns();
  file.put(written.get());
  file.put(written.get());
  file.close();
  const std::unique_ptr<mat_t, int (*)(mat_t*)> in(Mat_Open(path.c_str(), MAT_ACC_RDONLY), Mat_Close);
  ASSERT_NE(in, nullptr);
  for (int k = 0; k < 2; ++k) {
    const Variable read(Mat_VarReadNext(in.get()));
    ASSERT_NE(read, nullptr);
    const matvar_t* last = Mat_VarGetStructFieldByName(read.get(), "f", 0);
    ASSERT_NE(last, nullptr);
    ASSERT_EQ(last->nbytes, kRows * sizeof(double));
    EXPECT_EQ(static_cast<const double*>(last->data)[kRows - 1], static_cast<double>(kColumns * kRows - 1));
  }
  EXPECT_EQ(Variable(Mat_VarReadNext(in.get())), nullptr);
  EXPECT_LT(std::filesystem::file_size(path), kColumns * kRows * sizeof(double)) << "compressed";
}

/// libmatio reports no failed write. Of a variable that is cut within its last column even the length that it states is
/// that of the file, and one that is cut between two columns is a struct with fewer.
TEST(MatFile, AVariableThatTheDiskCutIsAnErrorWhereverItIsCut) {
  constexpr rlim_t kWhole = 240'560, kBefore = 224, kColumn = 56 + kRows * sizeof(double);  // tags, flags, dimensions
  static_assert(kBefore + kColumns * kColumn == kWhole);
  const TemporaryDirectory dir("mat");
  const Variable variable = columns();
  {
    const auto path = dir.path() / "plain.mat";
    const std::unique_ptr<mat_t, int (*)(mat_t*)> plain(Mat_CreateVer(path.c_str(), nullptr, MAT_FT_MAT5), Mat_Close);
    ASSERT_EQ(Mat_VarWrite(plain.get(), variable.get(), MAT_COMPRESSION_NONE), 0);
  }
  ASSERT_EQ(std::filesystem::file_size(dir.path() / "plain.mat"), kWhole);
  std::vector<rlim_t> limits;
  for (rlim_t bytes = 4'096; bytes < kWhole; bytes += 7'919) limits.push_back(bytes);
  for (std::size_t c = 0; c < kColumns; ++c)
    for (rlim_t after = 0; after <= 64; after += 8) limits.push_back(kBefore + c * kColumn + after);
  limits.push_back(kWhole - 8);
  for (const rlim_t limit : limits) {
    MatFile file(dir.path() / "cut.mat");
    const FileLimit full(limit);
    EXPECT_THROW(file.put(variable.get()), std::runtime_error) << limit << " bytes";
  }
  EXPECT_FALSE(std::filesystem::exists(dir.path() / "cut.mat.plain"));
}

}  // namespace
}  // namespace isorig::daemon::testing
