#include "daemon/recording/amendments.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <toml++/toml.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <ctime>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "base/beneath.hpp"
#include "base/toml_reader.hpp"
#include "base/utc_text.hpp"
#include "daemon/recording/run_directory.hpp"

namespace isorig::daemon {
namespace {

constexpr const char* kAmendmentsFormat = "isorig-amendments/1";

std::filesystem::path file_of(const std::filesystem::path& run_dir) {
  return run_dir / "amendments.toml";
}

std::runtime_error cannot_write(const std::filesystem::path& path, int error) {
  return std::runtime_error("cannot write " + path.string() + ": " + std::strerror(error));
}

}  // namespace

void append_amendment(const std::filesystem::path& run_dir, const Amendment& a) {
  (void)read_amendments(run_dir);  // behind a broken entry nothing could be read either
  toml::table entry{{"at_utc", a.at_utc}};
  for (const auto& [key, text] : {std::pair<const char*, const std::string&>{"by", a.by},
                                  {"specimen", a.specimen},
                                  {"operator", a.operator_name},
                                  {"text", a.text},
                                  {"specimen_file", a.specimen_file}}) {
    if (!text.empty()) entry.insert_or_assign(key, text);
  }
  std::ostringstream out;
  if (!std::filesystem::exists(file_of(run_dir))) out << "format = \"" << kAmendmentsFormat << "\"\n\n";
  out << "[[amendment]]\n" << entry << "\n\n";
  const auto text = out.str();
  const auto path = file_of(run_dir);
  // One write at the end of the file: what is there already is not touched.
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_NOFOLLOW | O_CLOEXEC, 0644);
  if (fd < 0) throw cannot_write(path, errno);
  struct stat before {};
  int error = ::fstat(fd, &before) == 0 ? 0 : errno;
  if (error == 0) {
    const auto written = ::write(fd, text.data(), text.size());
    // Fewer bytes than were given is a full disk, and sets no errno.
    if (written != static_cast<ssize_t>(text.size())) error = written < 0 ? errno : ENOSPC;
    if (error == 0 && ::fsync(fd) != 0) error = errno;
    // Half of an entry would make the notes before it unreadable, and those after it.
    if (error != 0 && ::ftruncate(fd, before.st_size) != 0) error = errno;
  }
  ::close(fd);
  if (error != 0) throw cannot_write(path, error);
  sync_directory(run_dir);
}

std::vector<Amendment> read_amendments(const std::filesystem::path& run_dir) {
  std::vector<Amendment> all;
  if (!std::filesystem::exists(file_of(run_dir))) return all;
  const auto document =
      base::TomlDocument::parse_text(base::read_text_beneath(run_dir, file_of({})), file_of(run_dir).string());
  const auto root = document.root();
  if (root.has("format")) (void)root.choice("format", {kAmendmentsFormat});  // files of before have none
  for (const auto& t : root.tables("amendment")) {
    all.push_back({t.string("at_utc"), t.string_or("by", ""), t.string_or("specimen", ""), t.string_or("operator", ""),
                   t.string_or("text", ""), t.string_or("specimen_file", "")});
  }
  document.finish();
  return all;
}

const Amendment* last_of_specimen(const std::vector<Amendment>& amendments) {
  const Amendment* last = nullptr;
  for (const Amendment& a : amendments)
    if (!a.specimen.empty()) last = &a;
  return last;
}

std::vector<Amendment> shown_amendments(const std::filesystem::path& run_dir) {
  try {
    return read_amendments(run_dir);
  } catch (const std::exception& e) {
    Amendment unreadable;
    unreadable.text = std::string("the notes cannot be read: ") + e.what();
    return {unreadable};
  }
}

std::string utc_now() {
  return base::utc_text(std::time(nullptr));
}

}  // namespace isorig::daemon
