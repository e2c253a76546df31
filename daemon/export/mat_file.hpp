#pragma once
#include <matio.h>

#include <cstdio>
#include <filesystem>
#include <memory>

#include "daemon/export/zlib_stream.hpp"

namespace isorig::daemon {

/// A MAT file of level 5 with compressed variables. libmatio writes each variable by itself, uncompressed, into a file
/// beside it, and here its element is compressed (MathWorks, MAT-File Format, "Data Elements": a compressed element is
/// the tag miCOMPRESSED and a zlib stream of the whole element). libmatio's own compression is zlib's level 6, which
/// cannot be changed and took more than half of an export, and reports no failed write (1.5.23 ignores what fwrite and
/// fclose say there).
class MatFile {
 public:
  /// Throws std::runtime_error, as all of this does: the disk takes no more, or the file cannot be made.
  explicit MatFile(const std::filesystem::path& path);
  ~MatFile();
  MatFile(const MatFile&) = delete;
  MatFile& operator=(const MatFile&) = delete;

  void put(matvar_t* variable);
  /// The file is whole after it.
  void close();

 private:
  void append(std::FILE* plain, std::uint64_t element_bytes);
  void write(const void* data, std::size_t bytes);

  std::filesystem::path plain_;
  std::FILE* out_;
  bool begun_ = false;
  ZlibStream compressed_;
};

}  // namespace isorig::daemon
