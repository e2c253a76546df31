#include <hdf5.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <optional>
#include <span>
#include <stdexcept>
#include <system_error>
#include <type_traits>

#include "daemon/export/writer.hpp"
#include "daemon/export/zlib_stream.hpp"

/// The C interface: HDF5's own C++ one reports errors no better and is not kept as well.
namespace isorig::daemon {
namespace {

using Closer = herr_t (*)(hid_t);

/// An identifier of HDF5's.
class Handle {
 public:
  Handle(hid_t id, Closer closer) : id_(id), close_(closer) {
    if (id_ < 0) throw std::runtime_error("HDF5 refused");
  }
  ~Handle() { reset(); }
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Handle& operator=(Handle&& other) noexcept {
    reset();
    id_ = std::exchange(other.id_, -1);
    close_ = other.close_;
    return *this;
  }
  /// Throws where the destructor would say nothing.
  void close() {
    if (id_ >= 0 && close_(std::exchange(id_, -1)) < 0) throw std::runtime_error("HDF5 refused");
  }
  operator hid_t() const noexcept { return id_; }  // NOLINT: as HDF5's functions want it

 private:
  void reset() noexcept {
    if (id_ >= 0) close_(std::exchange(id_, -1));
  }
  hid_t id_;
  Closer close_;
};

/// The library prints its stack of errors on the terminal unless it is told not to, each thread by itself.
void keep_errors_off_the_terminal() {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

void check(herr_t result) {
  if (result < 0) throw std::runtime_error("HDF5 refused");
}

Handle text_type() {
  Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
  check(H5Tset_size(type, H5T_VARIABLE));
  check(H5Tset_cset(type, H5T_CSET_UTF8));
  return type;
}

void put_attribute(hid_t to, const std::string& name, const Attribute& value) {
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose);
  const auto create = [&](hid_t type) {
    return Handle(H5Acreate2(to, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
  };
  if (const auto* text = std::get_if<std::string>(&value)) {
    const auto type = text_type();
    const char* at = text->c_str();
    check(H5Awrite(create(type), type, &at));
  } else if (const auto* number = std::get_if<double>(&value)) {
    check(H5Awrite(create(H5T_IEEE_F64LE), H5T_NATIVE_DOUBLE, number));
  } else {
    check(H5Awrite(create(H5T_STD_I64LE), H5T_NATIVE_INT64, &std::get<std::int64_t>(value)));
  }
}

void put_attributes(hid_t to, const Attributes& all) {
  for (const auto& [name, value] : all) put_attribute(to, name, value);
}

Handle group(hid_t in, const std::string& name) {
  return {H5Gcreate2(in, name.c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Gclose};
}

hid_t file_type(ColumnType type) {
  switch (type) {
    case ColumnType::kReal:
      return H5T_IEEE_F64LE;
    case ColumnType::kFlag:
      return H5T_STD_I8LE;
    case ColumnType::kSmall:
      return H5T_STD_I32LE;
    default:
      return H5T_STD_I64LE;
  }
}

/// A chunk as HDF5's own filters would leave it: the bytes of all values by their place in the value
/// (`H5Pset_shuffle`), then a zlib stream (`H5Pset_deflate`). ISA-L compresses several times as fast as the zlib that
/// HDF5 is built with.
class ChunkFilter {
 public:
  /// `values` as `Stored`, and zeros up to `chunk` of them. Valid until the next call.
  template <typename Stored, typename T>
  [[nodiscard]] std::span<const std::uint8_t> filtered(std::span<const T> values, std::size_t chunk) {
    static_assert(std::endian::native == std::endian::little, "the files' types are little-endian");
    shuffled_.assign(chunk * sizeof(Stored), 0);
    for (std::size_t i = 0; i < values.size(); ++i) {
      const auto bytes = std::bit_cast<std::array<std::uint8_t, sizeof(Stored)>>(static_cast<Stored>(values[i]));
      for (std::size_t b = 0; b < sizeof(Stored); ++b) shuffled_[b * chunk + i] = bytes[b];
    }
    compressed_.clear();
    zlib_.add(shuffled_, true, [this](std::span<const std::uint8_t> bytes) {
      compressed_.insert(compressed_.end(), bytes.begin(), bytes.end());
    });
    return compressed_;
  }

 private:
  ZlibStream zlib_;
  std::vector<std::uint8_t> shuffled_, compressed_;
};

/// A table as a group with a data set for each column: what h5py, MATLAB and h5dump read without further ado.
class TableGroup {
 public:
  TableGroup(hid_t in, const TableSchema& schema, std::size_t rows)
      : group_(group(in, schema.name)), text_type_(text_type()), chunk_(std::min(rows, kBlockRows)) {
    put_attribute(group_, "description", schema.description);
    put_attributes(group_, schema.attributes);
    const hsize_t size = rows;
    const Handle space(H5Screate_simple(1, &size, nullptr), H5Sclose);
    for (const auto& column : schema.columns) {
      const Handle how(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
      check(H5Pset_obj_track_times(how, false));  // no dates, so that two exports do not differ
      if (rows > 0) {
        const hsize_t chunk = chunk_;
        check(H5Pset_chunk(how, 1, &chunk));
        check(H5Pset_shuffle(how));
        check(H5Pset_deflate(how, 1));
      }
      const hid_t type = column.type == ColumnType::kText ? hid_t{text_type_} : file_type(column.type);
      sets_.emplace_back(H5Dcreate2(group_, column.name.c_str(), type, space, H5P_DEFAULT, how, H5P_DEFAULT), H5Dclose);
      put_attribute(sets_.back(), "unit", column.unit);
      put_attribute(sets_.back(), "description", column.description);
      put_attributes(sets_.back(), column.attributes);
    }
  }

  /// A whole table, or blocks of `kBlockRows` of which the last may be shorter.
  void append(const Table& block) {
    for (std::size_t from = 0; from < block.rows(); from += chunk_) {
      if (written_ % chunk_ != 0) throw std::logic_error("a block that is no chunk of an HDF5 file");
      const auto rows = std::min(chunk_, block.rows() - from);
      for (std::size_t c = 0; c < sets_.size(); ++c) {
        write(sets_[c], block.schema().columns[c].type, block.cells()[c], from, rows);
      }
      written_ += rows;
    }
  }

 private:
  void write(hid_t set, ColumnType type, const Cells& cells, std::size_t from, std::size_t rows) {
    const auto whole = [&] { return std::span(cells.whole).subspan(from, rows); };
    switch (type) {
      case ColumnType::kReal:
        return write_chunk(set, filter_.filtered<double>(std::span(cells.real).subspan(from, rows), chunk_));
      case ColumnType::kFlag:
        return write_chunk(set, filter_.filtered<std::int8_t>(whole(), chunk_));
      case ColumnType::kSmall:
        return write_chunk(set, filter_.filtered<std::int32_t>(whole(), chunk_));
      case ColumnType::kWhole:
        return write_chunk(set, filter_.filtered<std::int64_t>(whole(), chunk_));
      case ColumnType::kText:
        return write_texts(set, std::span(cells.text).subspan(from, rows));
    }
  }

  void write_chunk(hid_t set, std::span<const std::uint8_t> bytes) const {
    const hsize_t at = written_;
    check(H5Dwrite_chunk(set, H5P_DEFAULT, 0, &at, bytes.size(), bytes.data()));
  }

  /// Texts of any length lie in a heap of the file, and only their places in a chunk.
  void write_texts(hid_t set, std::span<const std::string> texts) const {
    std::vector<const char*> at;
    for (const auto& t : texts) at.push_back(t.c_str());
    const hsize_t from = written_, size = texts.size();
    const Handle memory(H5Screate_simple(1, &size, nullptr), H5Sclose);
    const Handle file(H5Dget_space(set), H5Sclose);
    check(H5Sselect_hyperslab(file, H5S_SELECT_SET, &from, nullptr, &size, nullptr));
    check(H5Dwrite(set, text_type_, memory, file, H5P_DEFAULT, at.data()));
  }

  Handle group_, text_type_;
  std::size_t chunk_;  // rows
  std::vector<Handle> sets_;
  ChunkFilter filter_;
  std::size_t written_ = 0;
};

void put_table(hid_t in, const Table& table) {
  TableGroup(in, table.schema(), table.rows()).append(table);
}

/// The file, written aside until it is whole.
struct File {
  explicit File(std::filesystem::path where) : path(std::move(where)), aside(path) {
    aside += ".new";
    // The library's exit handler closes what is still open: on a full disk the data sets whose H5Dclose failed, and it
    // crashes there (1.10.8, in H5F__close_cb). What is written whole is closed here. Refused from the second time on.
    (void)H5dont_atexit();
    keep_errors_off_the_terminal();
    const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
    check(H5Pset_libver_bounds(access, H5F_LIBVER_EARLIEST, H5F_LIBVER_V18));
    try {
      handle.emplace(H5Fcreate(aside.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access), H5Fclose);
    } catch (const std::runtime_error&) {  // on a full disk it makes the file all the same
      std::error_code ignored;
      std::filesystem::remove(aside, ignored);
      throw;
    }
  }
  ~File() {
    handle.reset();
    std::error_code ignored;
    if (!kept) std::filesystem::remove(aside, ignored);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;

  template <typename Act>
  auto guarded(Act act) const {
    try {
      return act();
    } catch (const std::runtime_error& e) {
      throw std::runtime_error(path.string() + ": cannot be written (" + e.what() +
                               "); check the disk's space and permissions");
    }
  }

  std::filesystem::path path, aside;
  std::optional<Handle> handle;
  bool kept = false;
};

class Hdf5Session : public SessionWriter {
 public:
  Hdf5Session(std::shared_ptr<File> file, const SessionHead& head) : file_(std::move(file)) {
    keep_errors_off_the_terminal();  // of the thread that writes
    file_->guarded([&] {
      group_.emplace(group(*file_->handle, head.name));
      for (std::size_t i = 0; i < kStreams; ++i) {
        if (head.rows[i] > 0) streams_[i].emplace(*group_, head.schema[i], head.rows[i]);
      }
    });
  }
  void rows(Stream stream, const Table& block) override {
    auto& to = streams_[static_cast<std::size_t>(stream)];
    if (to) file_->guarded([&] { to->append(block); });
  }
  void finish(const SessionTail& tail) override {
    file_->guarded([&] {
      put_attributes(*group_, tail.attributes);
      for (const auto& table : tail.tables) put_table(*group_, table);
    });
  }

 private:
  std::shared_ptr<File> file_;
  std::optional<Handle> group_;
  std::array<std::optional<TableGroup>, kStreams> streams_;
};

class Hdf5Writer : public ExportWriter {
 public:
  Hdf5Writer(const std::filesystem::path& out, const std::string& name) {
    std::error_code failed;
    std::filesystem::create_directories(out, failed);
    const auto path = out / (name + ".h5");
    if (failed) throw std::runtime_error(out.string() + ": cannot be made: " + failed.message());
    try {
      file_ = std::make_shared<File>(path);
    } catch (const std::runtime_error&) {
      throw std::runtime_error(path.string() + ": cannot be written; check the disk's space and permissions");
    }
  }
  std::unique_ptr<SessionWriter> open(const SessionHead& head) override {
    return std::make_unique<Hdf5Session>(file_, head);
  }
  [[nodiscard]] std::filesystem::path path_of(const std::string& session) const override {
    return file_->path / session;
  }
  /// The file is replaced with everything in it.
  bool drop(const std::string&, const std::string&, std::int32_t) override { return false; }
  void close(const Attributes& run, const Table& sessions,
             const std::vector<std::pair<std::string, std::string>>& texts) override {
    file_->guarded([&] {
      const hid_t root = *file_->handle;
      put_attribute(root, "format", std::string(kExportFormat));
      put_attributes(root, run);
      put_table(root, sessions);
      const auto inputs = group(root, "inputs");
      put_attribute(inputs, "description", std::string("the files that the run was started with"));
      for (const auto& [name, text] : texts) put_attribute(inputs, name, text);
      check(H5Fflush(root, H5F_SCOPE_GLOBAL));
    });
    file_->guarded([&] {
      // A data set that could not be closed would keep the file open and its chunks in memory.
      if (H5Fget_obj_count(*file_->handle, H5F_OBJ_ALL) != 1)
        throw std::runtime_error("HDF5 could not close all of it");
      file_->handle->close();
    });
    std::error_code failed;
    std::filesystem::rename(file_->aside, file_->path, failed);
    if (failed) throw std::runtime_error(file_->path.string() + ": cannot be replaced: " + failed.message());
    file_->kept = true;
  }

 private:
  std::shared_ptr<File> file_;
};

}  // namespace

std::unique_ptr<ExportWriter> make_hdf5_writer(const std::filesystem::path& out, const std::string& name) {
  return std::make_unique<Hdf5Writer>(out, name);
}

}  // namespace isorig::daemon
