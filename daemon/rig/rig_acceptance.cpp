#include "daemon/rig/rig_acceptance.hpp"

#include <fcntl.h>
#include <toml++/toml.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>

#include "base/number_text.hpp"
#include "base/utc_text.hpp"
#include "daemon/version.hpp"

namespace isorig::daemon {
namespace {

using nlohmann::json;

constexpr std::array kTables{"limits", "supervisor", "operator", "interlock", "pressure_loop", "calibration"};
constexpr const char* kNotSet = "(not set)";

void collect(const std::string& name, const toml::node& node, std::map<std::string, std::string>& into) {
  if (const auto* table = node.as_table()) {
    for (const auto& [key, value] : *table) collect(name + "." + std::string(key.str()), value, into);
  } else if (const auto number = node.value<double>(); node.is_number() && number) {
    into[name] = base::exact_number_text(*number);  // 120, 120.0 and 1.2e2 are one number
  } else {
    std::ostringstream text;
    node.visit([&](const auto& value) { text << value; });
    into[name] = text.str();
  }
}

/// A rig may be called anything; its file may not.
std::string file_name_of(std::string name) {
  std::replace_if(
      name.begin(), name.end(), [](unsigned char c) { return std::isalnum(c) == 0 && c != '-' && c != '_'; }, '-');
  return name + ".jsonl";
}

[[noreturn]] void fail(const std::filesystem::path& path, int error) {
  throw std::runtime_error(path.string() + " cannot be written: " + std::strerror(error) +
                           "; check the directory and its permissions");
}

void sync_directory(const std::filesystem::path& directory) {
  const int fd = ::open(directory.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return;
  ::fsync(fd);
  ::close(fd);
}

}  // namespace

std::map<std::string, std::string> safety_keys(std::string_view rig_toml) {
  std::map<std::string, std::string> keys;
  const toml::table root = toml::parse(rig_toml);
  for (const char* table : kTables) {
    if (const auto* node = root.get(table)) collect(table, *node, keys);
  }
  return keys;
}

RigAcceptance::RigAcceptance(std::string rig_name, std::string_view rig_toml, const std::filesystem::path& runs_root)
    : path_(runs_root / "accepted" / file_name_of(rig_name)), rig_(std::move(rig_name)), keys_(safety_keys(rig_toml)) {
  std::error_code ignored;
  if (!std::filesystem::exists(path_, ignored)) return;
  std::ifstream in(path_);
  if (!in) throw std::runtime_error(path_.string() + " cannot be read; check its permissions");
  json last;
  for (std::string line; std::getline(in, line);) {
    // A power cut can leave half a line: what was accepted before it still is.
    auto entry = json::parse(line, nullptr, false);
    if (entry.is_object() && entry.contains("keys") && entry["keys"].is_object() &&
        !entry.value("operator", "").empty())
      last = std::move(entry);
  }
  if (last.is_null()) return;
  operator_ = last.value("operator", "");
  when_utc_ = last.value("accepted_utc", "");
  uid_ = last.value("uid", uid_t{0});
  std::map<std::string, std::string> before;
  for (const auto& [key, value] : last["keys"].items())
    before[key] = value.is_string() ? value.get<std::string>() : value.dump();
  for (const auto& [key, value] : before) {
    const auto present = keys_.find(key);
    if (present == keys_.end()) {
      changes_.push_back({key, value, kNotSet});
    } else if (present->second != value) {
      changes_.push_back({key, value, present->second});
    }
  }
  for (const auto& [key, value] : keys_) {
    if (!before.contains(key)) changes_.push_back({key, kNotSet, value});
  }
}

std::string RigAcceptance::summary(std::size_t most) const {
  if (!ever()) return "the rig file was never accepted";
  if (changes_.empty()) return "the rig file is as " + operator_ + " accepted it on " + when_utc_;
  std::string text = "the rig file has changed since " + operator_ + " accepted it on " + when_utc_;
  for (std::size_t i = 0; i < changes_.size() && i < most; ++i) text += "\n  " + changes_[i].text();
  if (changes_.size() > most) text += "\n  and " + std::to_string(changes_.size() - most) + " more";
  return text;
}

void RigAcceptance::accept(const std::string& operator_name, uid_t uid, std::int64_t unix_s) {
  json keys = json::object(), changes = json::array();
  for (const auto& [key, value] : keys_) keys[key] = value;
  for (const auto& change : changes_) changes.push_back(change.text());
  const json entry{
      {"rig", rig_},        {"operator", operator_name}, {"uid", uid},  {"accepted_utc", base::utc_text(unix_s)},
      {"isorig", kVersion}, {"changes", changes},        {"keys", keys}};
  // A line of its own, whatever a power cut has left of the one before.
  const std::string line = "\n" + entry.dump(-1, ' ', false, json::error_handler_t::replace) + "\n";
  std::error_code error;
  std::filesystem::create_directories(path_.parent_path(), error);
  const int fd = ::open(path_.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0644);
  if (fd < 0) fail(path_, errno);
  const auto written = ::write(fd, line.data(), line.size());
  const int write_error = written < 0 ? errno : written == static_cast<ssize_t>(line.size()) ? 0 : ENOSPC;
  const int sync_error = write_error == 0 && ::fdatasync(fd) != 0 ? errno : 0;
  ::close(fd);
  if (write_error != 0 || sync_error != 0) fail(path_, write_error != 0 ? write_error : sync_error);
  sync_directory(path_.parent_path());
  operator_ = operator_name;
  uid_ = uid;
  when_utc_ = base::utc_text(unix_s);
  changes_.clear();
}

}  // namespace isorig::daemon
