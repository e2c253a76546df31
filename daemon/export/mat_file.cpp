#include "daemon/export/mat_file.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <system_error>
#include <utility>
#include <vector>

namespace isorig::daemon {
namespace {

constexpr std::size_t kHeaderBytes = 128;
constexpr std::uint32_t kMatrix = 14, kCompressed = 15;  // miMATRIX, miCOMPRESSED; MAT-File Format, table 1-1
constexpr std::size_t kPieceBytes = std::size_t{1} << 20U;

struct ClosePlain {
  void operator()(std::FILE* f) const noexcept { std::fclose(f); }
};
using PlainFile = std::unique_ptr<std::FILE, ClosePlain>;

[[noreturn]] void fail_mat(const char* what) {
  throw std::runtime_error(what);
}

/// Whether the element of `variable` whose content lies from `at` to `end` holds all of it (MAT-File Format, "Data
/// Element Format"). libmatio takes an element's length from where it has come to, so that of a variable that a full
/// disk cut the length is that of the file. The length of a column's numbers, written before them, is not, and a column
/// or its numbers that are not there at all are missed by counting.
bool is_whole(std::FILE* plain, std::uint64_t at, std::uint64_t end, const matvar_t& variable) {
  constexpr std::size_t kOwn = 4;  // of numbers and characters: flags, dimensions, name, data
  const bool nests = variable.class_type == MAT_C_STRUCT || variable.class_type == MAT_C_CELL;
  const std::size_t children =
      nests && variable.data_size > 0 ? variable.nbytes / static_cast<std::size_t>(variable.data_size) : std::size_t{0};
  const auto* const* child = static_cast<const matvar_t* const*>(variable.data);
  std::size_t own = 0, nested = 0;
  while (at < end) {
    std::array<std::uint32_t, 2> tag{};
    if (end - at < sizeof tag || std::fseek(plain, static_cast<long>(at), SEEK_SET) != 0 ||
        std::fread(tag.data(), sizeof tag, 1, plain) != 1) {
      return false;
    }
    at += sizeof tag;
    ++own;
    if (tag[0] >> 16U != 0) continue;  // up to four bytes, in the tag itself
    const std::uint64_t inside = at, bytes = (std::uint64_t{tag[1]} + 7U) / 8U * 8U;
    if (bytes > end - at) return false;
    at += bytes;
    if (tag[0] != kMatrix) continue;
    if (nested == children || child[nested] == nullptr || !is_whole(plain, inside, at, *child[nested])) return false;
    ++nested;
  }
  return nested == children && (nests || variable.nbytes == 0 || own >= kOwn);
}

struct RemovePlain {
  ~RemovePlain() {
    std::error_code ignored;
    std::filesystem::remove(path, ignored);
  }
  const std::filesystem::path& path;
};

}  // namespace

MatFile::MatFile(const std::filesystem::path& path) : plain_(path), out_(std::fopen(path.c_str(), "wbe")) {
  if (out_ == nullptr) fail_mat("a MAT file cannot be made");
  plain_ += ".plain";
}

MatFile::~MatFile() {
  if (out_ != nullptr) std::fclose(out_);
}

void MatFile::write(const void* data, std::size_t bytes) {
  if (std::fwrite(data, 1, bytes, out_) != bytes) fail_mat("a MAT file cannot be written");
}

void MatFile::put(matvar_t* variable) {
  const RemovePlain last{plain_};
  // MATLAB wants the first words. A date would make two exports of a run differ.
  mat_t* file = Mat_CreateVer(plain_.c_str(), "MATLAB 5.0 MAT-file, isorig-export/1", MAT_FT_MAT5);
  if (file == nullptr) fail_mat("a MAT variable cannot be kept");
  const bool written = Mat_VarWrite(file, variable, MAT_COMPRESSION_NONE) == 0;
  if ((Mat_Close(file) != 0) || !written) fail_mat("a MAT variable cannot be written");

  const PlainFile plain(std::fopen(plain_.c_str(), "rbe"));
  std::array<std::uint8_t, kHeaderBytes> header{};
  std::array<std::uint32_t, 2> tag{};  // type and bytes, in the byte order of the machine that writes
  if (!plain || std::fread(header.data(), 1, header.size(), plain.get()) != header.size() ||
      std::fread(tag.data(), sizeof tag, 1, plain.get()) != 1 || tag[0] != kMatrix) {
    fail_mat("a MAT variable cannot be read back");
  }
  std::error_code unknown;
  const std::uint64_t element_bytes = sizeof tag + std::uint64_t{tag[1]};
  // On a full disk libmatio says nothing, and the file ends early.
  if (std::filesystem::file_size(plain_, unknown) != kHeaderBytes + element_bytes || unknown ||
      !is_whole(plain.get(), kHeaderBytes + sizeof tag, kHeaderBytes + element_bytes, *variable)) {
    fail_mat("a MAT variable is not whole");
  }
  if (!begun_) write(header.data(), header.size());
  begun_ = true;
  std::fseek(plain.get(), kHeaderBytes, SEEK_SET);
  append(plain.get(), element_bytes);
}

void MatFile::append(std::FILE* plain, std::uint64_t element_bytes) {
  const long tag_at = std::ftell(out_);
  std::array<std::uint32_t, 2> tag{kCompressed, 0};
  write(tag.data(), sizeof tag);
  std::uint64_t compressed_bytes = 0;
  std::vector<std::uint8_t> piece(std::min<std::uint64_t>(element_bytes, kPieceBytes));
  for (std::uint64_t left = element_bytes; left > 0;) {
    const auto size = static_cast<std::size_t>(std::min<std::uint64_t>(left, piece.size()));
    if (std::fread(piece.data(), 1, size, plain) != size) fail_mat("a MAT variable cannot be read back");
    left -= size;
    compressed_.add({piece.data(), size}, left == 0, [&](std::span<const std::uint8_t> bytes) {
      write(bytes.data(), bytes.size());
      compressed_bytes += bytes.size();
    });
  }
  if (compressed_bytes > std::numeric_limits<std::uint32_t>::max()) fail_mat("a MAT variable is too large");
  tag[1] = static_cast<std::uint32_t>(compressed_bytes);
  if (tag_at < 0 || std::fseek(out_, tag_at, SEEK_SET) != 0) fail_mat("a MAT file cannot be written");
  write(tag.data(), sizeof tag);
  if (std::fseek(out_, 0, SEEK_END) != 0) fail_mat("a MAT file cannot be written");
}

void MatFile::close() {
  if (std::fclose(std::exchange(out_, nullptr)) != 0) fail_mat("a MAT file cannot be written");
}

}  // namespace isorig::daemon
