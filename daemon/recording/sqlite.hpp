#pragma once
#include <sqlite3.h>

#include <concepts>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>

/// As much of SQLite as the catalogue needs.
namespace isorig::daemon::sqlite {

/// SQLite's own result code beside its words.
struct Error : std::runtime_error {
  Error(const std::string& text, int result) : std::runtime_error(text), code(result & 0xff) {}
  int code;
};

[[noreturn]] inline void fail(sqlite3* db, const std::string& what) {
  const int code = sqlite3_extended_errcode(db);
  if ((code & 0xff) == SQLITE_NOTADB || (code & 0xff) == SQLITE_CORRUPT) {
    const char* name = sqlite3_db_filename(db, "main");
    const std::string file = name == nullptr ? "the catalogue" : name;
    throw Error(file + " is damaged, or no catalogue (SQLite: " + sqlite3_errmsg(db) +
                    "); move it aside together with its -wal and -shm: the next isorigd, or isorig run, makes it anew "
                    "from the recordings beside it",
                code);
  }
  const char* file = sqlite3_db_filename(db, "main");
  const std::string of = file == nullptr || *file == '\0' ? "" : std::string(" ") + file;
  std::string cure;
  if ((code & 0xff) == SQLITE_READONLY || (code & 0xff) == SQLITE_PERM)
    cure = "; you may not write there: name another place (--runs), or have its owner give you the right";
  if ((code & 0xff) == SQLITE_CANTOPEN)
    cure = "; you may not read or write there: name another place (--runs), or have its owner give you the right";
  throw Error("catalogue" + of + ": " + what + ": " + sqlite3_errmsg(db) + cure, code);
}

inline void execute(sqlite3* db, const char* sql) {
  if (sqlite3_exec(db, sql, nullptr, nullptr, nullptr) != SQLITE_OK) fail(db, sql);
}

/// A prepared statement with its values: Statement(db, "... ?1 ... ?2").bind(a, b).
class Statement {
 public:
  Statement(sqlite3* db, const char* sql) : db_(db) {
    if (sqlite3_prepare_v2(db, sql, -1, &statement_, nullptr) != SQLITE_OK) fail(db, sql);
  }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  template <typename... Values>
  Statement& bind(const Values&... values) {
    int i = 0;
    (bind_one(++i, values), ...);
    return *this;
  }
  /// True: there is a row.
  bool step() {
    const int result = sqlite3_step(statement_);
    if (result != SQLITE_ROW && result != SQLITE_DONE) fail(db_, sqlite3_sql(statement_));
    return result == SQLITE_ROW;
  }
  void run() {
    while (step()) {
    }
  }
  [[nodiscard]] std::string text(int column) const {
    const auto* t = reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
    return t == nullptr ? std::string() : std::string(t);
  }
  [[nodiscard]] std::int64_t integer(int column) const { return sqlite3_column_int64(statement_, column); }
  [[nodiscard]] double real(int column) const { return sqlite3_column_double(statement_, column); }

 private:
  void bind_one(int i, std::string_view v) {
    sqlite3_bind_text(statement_, i, v.data(), static_cast<int>(v.size()), SQLITE_TRANSIENT);
  }
  void bind_one(int i, double v) { sqlite3_bind_double(statement_, i, v); }
  template <std::integral Integer>
  void bind_one(int i, Integer v) {
    sqlite3_bind_int64(statement_, i, static_cast<std::int64_t>(v));
  }

  sqlite3* db_;
  sqlite3_stmt* statement_ = nullptr;
};

/// All or nothing: rolls back unless commit() was reached.
class Transaction {
 public:
  explicit Transaction(sqlite3* db) : db_(db) { execute(db, "BEGIN IMMEDIATE"); }
  ~Transaction() {
    if (!done_) sqlite3_exec(db_, "ROLLBACK", nullptr, nullptr, nullptr);
  }
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  void commit() {
    execute(db_, "COMMIT");
    done_ = true;
  }

 private:
  sqlite3* db_;
  bool done_ = false;
};

}  // namespace isorig::daemon::sqlite
