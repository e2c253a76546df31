#include <matio.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <system_error>

#include "daemon/export/column_spool.hpp"
#include "daemon/export/mat_file.hpp"
#include "daemon/export/new_folder.hpp"
#include "daemon/export/writer.hpp"

/// MATLAB's level 5, compressed: every MATLAB since 7 and Octave read it, which is not so for 7.3.
namespace isorig::daemon {
namespace {

/// A variable of a level 5 file; MATLAB itself writes none that is larger.
constexpr std::size_t kMostBytes = std::numeric_limits<std::int32_t>::max();

struct Free {
  void operator()(matvar_t* v) const noexcept { Mat_VarFree(v); }
};
using Variable = std::unique_ptr<matvar_t, Free>;

/// matio copies the data unless `how` says that it must not; it never writes into it.
Variable made(const char* name, matio_classes kind, matio_types type, std::array<std::size_t, 2> dims, const void* data,
              int how = 0) {
  matvar_t* v = Mat_VarCreate(name, kind, type, 2, dims.data(), const_cast<void*>(data), how);
  if (v == nullptr) throw std::runtime_error("a MAT variable cannot be made");
  return Variable(v);
}

/// UTF-8 as MATLAB keeps characters; what is no UTF-8 becomes '?'.
std::vector<std::uint16_t> utf16(const std::string& text) {
  std::vector<std::uint16_t> out;
  for (std::size_t i = 0; i < text.size();) {
    const auto lead = static_cast<unsigned char>(text[i++]);
    const int more = lead < 0x80 ? 0 : lead >= 0xF0 ? 3 : lead >= 0xE0 ? 2 : lead >= 0xC0 ? 1 : -1;
    std::uint32_t code = more < 0 ? '?' : more == 0 ? lead : lead & (0x3FU >> static_cast<unsigned>(more));
    for (int k = 0; k < more; ++k) {
      if (i >= text.size() || (static_cast<unsigned char>(text[i]) & 0xC0U) != 0x80U) {
        code = '?';
        break;
      }
      code = code << 6U | (static_cast<unsigned char>(text[i++]) & 0x3FU);
    }
    if (code >= 0x10000U) {
      code -= 0x10000U;
      out.push_back(static_cast<std::uint16_t>(0xD800U + (code >> 10U)));
      code = 0xDC00U + (code & 0x3FFU);
    }
    out.push_back(static_cast<std::uint16_t>(code));
  }
  return out;
}

Variable text_variable(const char* name, const std::string& text) {
  const bool ascii = std::all_of(text.begin(), text.end(), [](char c) { return static_cast<signed char>(c) >= 0; });
  if (ascii) {
    return made(name, MAT_C_CHAR, MAT_T_UTF8, {text.empty() ? 0U : 1U, text.size()}, text.data());
  }
  const auto wide = utf16(text);
  return made(name, MAT_C_CHAR, MAT_T_UINT16, {1, wide.size()}, wide.data());
}

Variable number_variable(const char* name, double value) {
  return made(name, MAT_C_DOUBLE, MAT_T_DOUBLE, {1, 1}, &value);
}

Variable attribute_variable(const char* name, const Attribute& value) {
  if (const auto* text = std::get_if<std::string>(&value)) return text_variable(name, *text);
  if (const auto* number = std::get_if<double>(&value)) return number_variable(name, *number);
  return made(name, MAT_C_INT64, MAT_T_INT64, {1, 1}, &std::get<std::int64_t>(value));
}

Variable struct_variable(const char* name, std::vector<std::pair<std::string, Variable>> fields) {
  std::vector<const char*> names;
  names.reserve(fields.size());
  for (const auto& [field, value] : fields) names.push_back(field.c_str());
  std::size_t dims[2] = {1, 1};
  Variable out(Mat_VarCreateStruct(name, 2, dims, names.data(), static_cast<unsigned>(names.size())));
  if (!out) throw std::runtime_error("a MAT variable cannot be made");
  for (std::size_t i = 0; i < fields.size(); ++i) {
    Mat_VarSetStructFieldByIndex(out.get(), i, 0, fields[i].second.release());
  }
  return out;
}

void add(std::vector<std::pair<std::string, Variable>>& to, const Attributes& all) {
  for (const auto& [name, value] : all) {
    // The last of two counts, as in a table.
    const auto same = std::find_if(to.begin(), to.end(), [&n = name](const auto& f) { return f.first == n; });
    auto variable = attribute_variable(name.c_str(), value);
    if (same != to.end()) {
      same->second = std::move(variable);
    } else {
      to.emplace_back(name, std::move(variable));
    }
  }
}

/// info.frame.description, info.frame.device, info.frame.columns.position_mm.unit
Variable info_variable(const TableSchema& schema) {
  std::vector<std::pair<std::string, Variable>> fields, columns;
  fields.emplace_back("description", text_variable("description", schema.description));
  add(fields, schema.attributes);
  for (const auto& c : schema.columns) {
    std::vector<std::pair<std::string, Variable>> of;
    of.emplace_back("unit", text_variable("unit", c.unit));
    of.emplace_back("description", text_variable("description", c.description));
    add(of, c.attributes);
    columns.emplace_back(c.name, struct_variable(c.name.c_str(), std::move(of)));
  }
  fields.emplace_back("columns", struct_variable("columns", std::move(columns)));
  return struct_variable(schema.name.c_str(), std::move(fields));
}

/// Numbers as double, so that they can be reckoned with; what needs 64 bits as int64.
Variable column_variable(const Column& column, const void* data, std::size_t rows, int how) {
  const bool whole = column.type == ColumnType::kWhole;
  return made(column.name.c_str(), whole ? MAT_C_INT64 : MAT_C_DOUBLE, whole ? MAT_T_INT64 : MAT_T_DOUBLE, {rows, 1},
              data, how);
}

Variable cells_variable(const Column& column, const Cells& cells, std::size_t rows) {
  if (column.type == ColumnType::kReal) return column_variable(column, cells.real.data(), rows, 0);
  if (column.type == ColumnType::kWhole) return column_variable(column, cells.whole.data(), rows, 0);
  if (column.type != ColumnType::kText) {
    const std::vector<double> numbers(cells.whole.begin(), cells.whole.end());
    return column_variable(column, numbers.data(), rows, 0);
  }
  std::vector<matvar_t*> each;
  for (const auto& t : cells.text) each.push_back(text_variable(nullptr, t).release());
  return made(column.name.c_str(), MAT_C_CELL, MAT_T_CELL, {rows, 1}, each.data());
}

class MatSession : public SessionWriter {
 public:
  MatSession(const std::filesystem::path& out, const SessionHead& head)
      : folder_(out), path_(out / (head.name + ".mat")) {
    for (std::size_t i = 0; i < kStreams; ++i) {
      schema_[i] = head.schema[i];
      rows_[i] = head.rows[i];
      if (head.rows[i] * schema_[i].columns.size() * sizeof(double) > kMostBytes) {
        throw std::runtime_error(path_.string() + ": `" + schema_[i].name + "` has " + std::to_string(head.rows[i]) +
                                 " rows, more than the 2 GiB that a variable of a MAT file holds; --format hdf5 has "
                                 "no such limit, and MATLAB reads it with h5read");
      }
      or_say([&] {
        for (std::size_t c = 0; c < schema_[i].columns.size(); ++c)
          columns_[i].push_back(std::make_unique<ColumnSpool>(out));
      });
    }
  }

  void rows(Stream stream, const Table& block) override {
    or_say([&] { keep(static_cast<std::size_t>(stream), block); });
  }

  void finish(const SessionTail& tail) override {
    auto aside = path_;
    aside += ".new";
    or_say([&] {
      try {
        write(aside, tail);
        std::filesystem::rename(aside, path_);
      } catch (...) {
        std::error_code ignored;
        std::filesystem::remove(aside, ignored);
        throw;
      }
    });
  }

 private:
  /// What goes wrong in `work` says which file it was for.
  template <typename Work>
  void or_say(Work&& work) const {
    try {
      work();
    } catch (const std::exception& e) {
      throw std::runtime_error(path_.string() + ": cannot be written (" + e.what() +
                               "); check the disk's space and permissions");
    }
  }

  void keep(std::size_t i, const Table& block) {
    std::vector<double> numbers;
    for (std::size_t c = 0; c < columns_[i].size(); ++c) {
      const auto& cells = block.cells()[c];
      const auto type = schema_[i].columns[c].type;
      if (type == ColumnType::kReal) {
        columns_[i][c]->append(cells.real.data(), cells.real.size() * sizeof(double));
      } else if (type == ColumnType::kWhole) {
        columns_[i][c]->append(cells.whole.data(), cells.whole.size() * sizeof(std::int64_t));
      } else {
        numbers.assign(cells.whole.begin(), cells.whole.end());
        columns_[i][c]->append(numbers.data(), numbers.size() * sizeof(double));
      }
    }
  }

  void write(const std::filesystem::path& aside, const SessionTail& tail) {
    MatFile file(aside);
    const auto put = [&](const Variable& v) { file.put(v.get()); };
    std::vector<std::pair<std::string, Variable>> recording, info;
    recording.emplace_back("format", text_variable("format", kExportFormat));
    add(recording, tail.attributes);
    put(struct_variable("recording", std::move(recording)));
    for (std::size_t i = 0; i < kStreams; ++i) {
      if (rows_[i] == 0) continue;
      std::vector<std::pair<std::string, Variable>> fields;
      for (std::size_t c = 0; c < columns_[i].size(); ++c) {
        const auto& column = schema_[i].columns[c];
        fields.emplace_back(column.name,
                            column_variable(column, columns_[i][c]->map(), rows_[i], MAT_F_DONT_COPY_DATA));
      }
      put(struct_variable(schema_[i].name.c_str(), std::move(fields)));
      info.emplace_back(schema_[i].name, info_variable(schema_[i]));
    }
    for (const auto& table : tail.tables) {
      std::vector<std::pair<std::string, Variable>> fields;
      for (std::size_t c = 0; c < table.cells().size(); ++c) {
        const auto& column = table.schema().columns[c];
        fields.emplace_back(column.name, cells_variable(column, table.cells()[c], table.rows()));
      }
      put(struct_variable(table.schema().name.c_str(), std::move(fields)));
      info.emplace_back(table.schema().name, info_variable(table.schema()));
    }
    put(struct_variable("info", std::move(info)));
    file.close();
  }

  NewFolder folder_;  // before its files: it goes after them
  std::filesystem::path path_;
  std::array<TableSchema, kStreams> schema_;
  std::array<std::size_t, kStreams> rows_{};
  std::array<std::vector<std::unique_ptr<ColumnSpool>>, kStreams> columns_;
};

/// Whether a MAT file of ours says that it is of this session.
bool is_of(const std::filesystem::path& file, const std::string& run, std::int32_t session) {
  const std::unique_ptr<mat_t, int (*)(mat_t*)> in(Mat_Open(file.c_str(), MAT_ACC_RDONLY), Mat_Close);
  if (in == nullptr) return false;
  const Variable recording(Mat_VarRead(in.get(), "recording"));
  if (recording == nullptr || recording->class_type != MAT_C_STRUCT) return false;
  const auto field = [&](const char* name) { return Mat_VarGetStructFieldByName(recording.get(), name, 0); };
  const matvar_t* number = field("session");
  if (number == nullptr || number->class_type != MAT_C_INT64 || number->data == nullptr ||
      number->nbytes != sizeof(std::int64_t) || *static_cast<const std::int64_t*>(number->data) != session) {
    return false;
  }
  // Characters as they were written: texts of the same bytes are the same.
  const auto expected = text_variable("run", run);
  const matvar_t* text = field("run");
  return text != nullptr && text->class_type == MAT_C_CHAR && text->data_type == expected->data_type &&
         text->data != nullptr && text->nbytes == expected->nbytes &&
         std::memcmp(text->data, expected->data, text->nbytes) == 0;
}

class MatWriter : public ExportWriter {
 public:
  explicit MatWriter(std::filesystem::path out) : out_(std::move(out)) {}
  std::unique_ptr<SessionWriter> open(const SessionHead& head) override {
    return std::make_unique<MatSession>(out_, head);
  }
  [[nodiscard]] std::filesystem::path path_of(const std::string& session) const override {
    return out_ / (session + ".mat");
  }
  void close(const Attributes&, const Table&, const std::vector<std::pair<std::string, std::string>>&) override {}
  bool drop(const std::string& name, const std::string& run, std::int32_t session) override {
    const auto path = path_of(name);
    std::error_code failed;
    if (!std::filesystem::is_regular_file(path, failed) || !is_of(path, run, session)) return false;
    std::filesystem::remove(path, failed);
    if (failed) {
      throw std::runtime_error(path.string() +
                               ": of an earlier export that named the session otherwise, cannot be "
                               "removed: " +
                               failed.message() + "; remove it, or the session counts twice");
    }
    return true;
  }

 private:
  std::filesystem::path out_;
};

}  // namespace

std::unique_ptr<ExportWriter> make_mat_writer(const std::filesystem::path& out) {
  return std::make_unique<MatWriter>(out);
}

}  // namespace isorig::daemon
