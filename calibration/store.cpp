#include "calibration/store.hpp"

#include <fcntl.h>
#include <toml++/toml.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <sstream>
#include <stdexcept>

#include "base/text_file.hpp"
#include "base/toml_reader.hpp"

namespace isorig::calibration {
namespace {

/// Whole or not at all: the name appears when the bytes are on the disk, and never in the place of another.
void write_once(const std::filesystem::path& path, const std::string& text) {
  const auto draft = path.parent_path() / ("." + path.filename().string() + ".new");
  const auto fail = [&](const char* what) {
    const int error = errno;
    ::unlink(draft.c_str());
    throw std::runtime_error(std::string(what) + " " + path.string() + ": " + std::strerror(error));
  };
  const int fd = ::open(draft.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0644);
  if (fd < 0) fail("cannot write");
  const bool written = ::write(fd, text.data(), text.size()) == static_cast<ssize_t>(text.size()) && ::fsync(fd) == 0;
  ::close(fd);
  if (!written) fail("cannot write");
  if (::link(draft.c_str(), path.c_str()) != 0) fail("a record is never replaced; cannot make");
  ::unlink(draft.c_str());
  if (const int folder = ::open(path.parent_path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC); folder >= 0) {
    ::fsync(folder);
    ::close(folder);
  }
}

}  // namespace

Store::Store(std::filesystem::path directory, std::array<Correction, 3> fallback)
    : directory_(std::move(directory)), fallback_(fallback) {
  std::error_code none;
  std::vector<base::Diagnostic> wrong;
  for (const auto& entry : std::filesystem::directory_iterator(directory_, none)) {
    const auto& path = entry.path();
    if (path.extension() != ".toml" || path.filename().string().front() == '.') continue;
    try {
      auto record = parse_record(base::read_config_file(path), path.string());
      if (record.id != path.stem().string()) {
        wrong.push_back({path.string(), 0, 0, "holds the record " + record.id + "; a record's file has its name"});
      }
      records_.push_back(std::move(record));
    } catch (const base::ConfigError& e) {
      wrong.insert(wrong.end(), e.diagnostics().begin(), e.diagnostics().end());
    }
  }
  if (!wrong.empty()) throw base::ConfigError(std::move(wrong));
  std::sort(records_.begin(), records_.end(), [](const Record& a, const Record& b) { return a.id < b.id; });
}

InForce Store::in_force(Channel channel) const {
  InForce f;
  f.channel = channel;
  f.correction = fallback_[static_cast<std::size_t>(channel)];
  for (const auto& r : records_) {
    if (r.channel != channel) continue;
    f.record = &r;
    f.correction = r.result.correction;
  }
  return f;
}

void Store::add(const Record& record) {
  const auto current = in_force(record.channel);
  const std::string before = current.record == nullptr ? "" : current.record->id;
  if (record.supersedes != before) {
    throw std::runtime_error("the record follows " + (record.supersedes.empty() ? "none" : record.supersedes) +
                             ", and " + (before.empty() ? "none" : before) +
                             " is in force: somebody calibrated meanwhile; do it again");
  }
  if (std::abs(record.before.scale - current.correction.scale) > 1e-9 ||
      std::abs(record.before.offset - current.correction.offset) > 1e-9) {
    throw std::runtime_error("the record starts from another correction than the one in force; do it again");
  }
  if (!before.empty() && record.id <= before) {
    throw std::runtime_error("the record " + record.id + " is not younger than " + before +
                             "; check the machine's clock");
  }
  std::error_code error;
  std::filesystem::create_directories(directory_, error);
  if (error)
    throw std::runtime_error("cannot make " + directory_.string() + ": " + error.message() +
                             "; check [calibration] records");
  write_once(directory_ / (record.id + ".toml"), to_toml(record));
  records_.push_back(record);
}

std::vector<std::string> Store::overdue(std::string_view today) const {
  std::vector<std::string> texts;
  for (const auto c : kChannels) {
    const auto f = in_force(c);
    if (f.record != nullptr && f.record->overdue(today)) texts.push_back(overdue_text(*f.record));
  }
  return texts;
}

std::string Store::toml() const {
  toml::table all;
  for (const auto c : kChannels) {
    const auto f = in_force(c);
    toml::table t{{"unit", unit_of(c)}, {"scale", f.correction.scale}, {"offset", f.correction.offset}};
    if (f.record == nullptr) {
      t.insert("id", "");
    } else {
      const auto& r = *f.record;
      t.insert("id", r.id);
      t.insert("mode", name_of(r.mode));
      t.insert("made_utc", r.made_utc);
      t.insert("due", r.due);
      t.insert("operator", r.operator_name);
      t.insert("reference", r.reference.id);
      t.insert("reference_due", r.reference.certificate_due);
      t.insert("uncertainty_k2", r.result.uncertainty);
      t.insert("as_found_max_error", r.result.as_found_max);
      t.insert("as_left_max_error", r.result.as_left_max);
      if (r.result.hysteresis) t.insert("hysteresis", *r.result.hysteresis);
      if (r.result.class_left) t.insert("iso_7500_1_like_class", r.result.class_left->text);
    }
    all.insert(name_of(c), t);
  }
  std::ostringstream out;
  out << all << '\n';
  return out.str();
}

std::string overdue_text(const Record& r) {
  return std::string("calibration of ") + name_of(r.channel) + " (" + r.id + ") was due on " + r.due;
}

}  // namespace isorig::calibration
