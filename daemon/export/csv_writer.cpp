#include <toml++/toml.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <deque>
#include <fstream>
#include <optional>
#include <stdexcept>
#include <system_error>

#include "daemon/export/new_folder.hpp"
#include "daemon/export/writer.hpp"
#include "messages/csv.hpp"

namespace isorig::daemon {
namespace {

/// Columns that the recording format fixes, at the beginning of frame.csv and pressure.csv.
constexpr std::array<std::size_t, kStreams> kFixed{3, 2, 0};
constexpr std::array<const char*, kStreams> kFiles{"frame.csv", "pressure.csv", "setpoints.csv"};

void put_whole(std::string& to, std::int64_t value) {
  char digits[24];
  to.append(digits, std::to_chars(digits, digits + sizeof digits, value).ptr);
}

/// With at most `decimals` digits behind the point, no zeros at their end; nothing for what is no number.
void put_real(std::string& to, double value, int decimals) {
  if (!std::isfinite(value)) return;
  constexpr std::array<double, 13> kPowers{1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12};
  const double units = std::nearbyint(std::abs(value) * kPowers[static_cast<std::size_t>(std::clamp(decimals, 0, 12))]);
  char digits[32];
  if (!(units < 9e15)) {
    to.append(digits, std::to_chars(digits, digits + sizeof digits, value).ptr);
    return;
  }
  auto rest = static_cast<std::uint64_t>(units);
  if (rest == 0) {
    to += '0';
    return;
  }
  while (decimals > 0 && rest % 10 == 0) {
    rest /= 10;
    --decimals;
  }
  char* const end = digits + sizeof digits;
  char* at = end;
  for (int i = 0; i < decimals; ++i, rest /= 10) *--at = static_cast<char>('0' + rest % 10);
  if (decimals > 0) *--at = '.';
  do {
    *--at = static_cast<char>('0' + rest % 10);
    rest /= 10;
  } while (rest > 0);
  if (value < 0.0) *--at = '-';
  to.append(at, static_cast<std::size_t>(end - at));
}

/// RFC 4180: in quotes where it has to be.
void put_text(std::string& to, const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) {
    to += text;
    return;
  }
  to += '"';
  for (const char c : text) {
    if (c == '"') to += '"';
    to += c;
  }
  to += '"';
}

std::string header_of(const TableSchema& schema, std::size_t columns) {
  std::string text;
  for (std::size_t c = 0; c < columns; ++c) text += (c > 0 ? "," : "") + schema.columns[c].name;
  return text + '\n';
}

void put_rows(std::string& to, const Table& table, std::size_t columns) {
  for (std::size_t r = 0; r < table.rows(); ++r) {
    for (std::size_t c = 0; c < columns; ++c) {
      const auto& column = table.schema().columns[c];
      const auto& cells = table.cells()[c];
      if (c > 0) to += ',';
      if (column.type == ColumnType::kReal) {
        put_real(to, cells.real[r], column.decimals);
      } else if (column.type == ColumnType::kText) {
        put_text(to, cells.text[r]);
      } else {
        put_whole(to, cells.whole[r]);
      }
    }
    to += '\n';
  }
}

/// Written aside, in its place by keep(), gone without it.
class NewFile {
 public:
  explicit NewFile(std::filesystem::path path) : path_(std::move(path)), aside_(path_) {
    aside_ += ".new";
    out_.open(aside_, std::ios::binary | std::ios::trunc);
    check();
  }
  ~NewFile() {
    out_.close();
    std::error_code ignored;
    if (!kept_) std::filesystem::remove(aside_, ignored);
  }
  NewFile(const NewFile&) = delete;
  NewFile& operator=(const NewFile&) = delete;
  /// By who writes a file of that name itself.
  template <typename Write>
  void fill(Write write) {
    out_.close();
    write(aside_);
  }
  void write(const std::string& text) {
    out_.write(text.data(), static_cast<std::streamsize>(text.size()));
    check();
  }
  /// Nothing can be missing after it: what remains for keep() is the new name.
  void close() {
    std::error_code ignored;
    if (std::filesystem::is_directory(path_, ignored))
      throw std::runtime_error(path_.string() + ": cannot be replaced: it is a folder");
    if (!out_.is_open()) return;
    out_.close();
    check();
  }
  void keep() {
    close();
    std::error_code failed;
    std::filesystem::rename(aside_, path_, failed);
    if (failed) throw std::runtime_error(path_.string() + ": cannot be replaced: " + failed.message());
    kept_ = true;
  }

 private:
  void check() {
    if (!out_) throw std::runtime_error(path_.string() + ": cannot be written; check the disk's space and permissions");
  }
  std::filesystem::path path_, aside_;
  std::ofstream out_;
  bool kept_ = false;
};

class CsvSession : public SessionWriter {
 public:
  CsvSession(std::filesystem::path folder, const SessionHead& head, bool lean)
      : folder_{std::move(folder)}, lean_(lean) {
    for (std::size_t i = 0; i < kStreams; ++i) {
      if (head.rows[i] == 0 || (lean && kFixed[i] == 0)) continue;
      columns_[i] = lean ? kFixed[i] : head.schema[i].columns.size();
      files_[i].emplace(folder_.path() / kFiles[i]);
      files_[i]->write(header_of(head.schema[i], columns_[i]));
    }
  }

  void rows(Stream stream, const Table& block) override {
    const auto i = static_cast<std::size_t>(stream);
    if (!files_[i] || block.rows() == 0) return;
    check(i, block);
    text_.clear();
    put_rows(text_, block, columns_[i]);
    files_[i]->write(text_);
  }

  void finish(const SessionTail& tail) override {
    // All of it is on the disk before anything of an earlier export is replaced. The old recording.toml goes before all
    // else and the new one comes last: a folder without it is no recording.
    std::deque<NewFile> tables;
    for (const auto& table : tail.tables) {
      if (lean_) break;
      std::string text = header_of(table.schema(), table.schema().columns.size());
      put_rows(text, table, table.schema().columns.size());
      auto& file = tables.emplace_back(folder_.path() / (table.schema().name + ".csv"));
      file.write(text);
      file.close();
    }
    for (auto& file : files_) {
      if (file) file->close();
    }
    NewFile metadata(folder_.path() / "recording.toml");
    metadata.fill([&](const std::filesystem::path& aside) { messages::write_recording_toml(aside, tail.metadata); });
    metadata.close();
    std::error_code ignored;
    const bool earlier = std::filesystem::remove(folder_.path() / "recording.toml", ignored);
    for (const auto table : messages::kRecordingTables) {
      const auto file = folder_.path() / (std::string(table) + ".csv");
      if (earlier && !std::filesystem::is_directory(file, ignored)) std::filesystem::remove(file, ignored);
    }
    for (std::size_t i = 0; i < kStreams; ++i) {
      if (files_[i]) {
        files_[i]->keep();
      } else {
        std::filesystem::remove(folder_.path() / kFiles[i], ignored);  // of an earlier export
      }
    }
    for (auto& file : tables) file.keep();
    metadata.keep();
  }

 private:
  /// As the recordings' readers will, from the last row of the block before.
  void check(std::size_t i, const Table& block) {
    if (kFixed[i] == 0) return;
    auto& seen = seen_[i];
    const bool first = seen[0].empty();
    std::array<messages::CsvColumnView, 3> views;
    for (std::size_t c = 0; c < kFixed[i]; ++c) {
      const auto& cells = block.cells()[c].real;
      if (!first) seen[c] = {seen[c].back()};
      seen[c].insert(seen[c].end(), cells.begin(), cells.end());
      views[c] = {block.schema().columns[c].name, seen[c]};
    }
    messages::check_columns(folder_.path() / kFiles[i], {views.data(), kFixed[i]}, first ? 2 : line_[i]);
    line_[i] += block.rows() + (first ? 1 : 0);
  }

  NewFolder folder_;  // before its files: it goes after them
  bool lean_;
  std::array<std::optional<NewFile>, kStreams> files_;
  std::array<std::size_t, kStreams> columns_{};
  std::array<std::array<std::vector<double>, 3>, kStreams> seen_;
  std::array<std::size_t, kStreams> line_{};  ///< of the row before
  std::string text_;
};

class CsvWriter : public ExportWriter {
 public:
  CsvWriter(std::filesystem::path out, bool lean) : out_(std::move(out)), lean_(lean) {}
  std::unique_ptr<SessionWriter> open(const SessionHead& head) override {
    return std::make_unique<CsvSession>(out_ / head.name, head, lean_);
  }
  [[nodiscard]] std::filesystem::path path_of(const std::string& session) const override { return out_ / session; }
  void close(const Attributes&, const Table&, const std::vector<std::pair<std::string, std::string>>&) override {}
  /// What somebody else put into the folder stays there: without recording.toml it is no recording.
  bool drop(const std::string& name, const std::string& run, std::int32_t session) override {
    const auto folder = out_ / name;
    std::error_code failed;
    if (!std::filesystem::is_regular_file(folder / "recording.toml", failed)) return false;
    try {
      const auto told = toml::parse_file((folder / "recording.toml").string());
      if (told["run"].value<std::string>() != run || told["session"].value<std::int64_t>() != session) return false;
    } catch (const toml::parse_error&) {
      return false;
    }
    const auto remove = [&](const std::string& file) {
      std::filesystem::remove(folder / file, failed);
      if (failed) {
        throw std::runtime_error((folder / file).string() +
                                 ": of an earlier export that named the session otherwise, cannot be removed: " +
                                 failed.message() + "; remove " + folder.string() + ", or the session counts twice");
      }
    };
    remove("recording.toml");
    for (const char* file : kFiles) remove(file);
    for (const auto table : messages::kRecordingTables) remove(std::string(table) + ".csv");
    std::filesystem::remove(folder, failed);  // fails when something is in it
    return true;
  }

 private:
  std::filesystem::path out_;
  bool lean_;
};

}  // namespace

std::unique_ptr<ExportWriter> make_csv_writer(const std::filesystem::path& out, bool lean) {
  return std::make_unique<CsvWriter>(out, lean);
}

}  // namespace isorig::daemon
