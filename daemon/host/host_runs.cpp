#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/beneath.hpp"
#include "base/report_pages.hpp"
#include "daemon/host/host.hpp"
#include "daemon/host/not_there.hpp"
#include "daemon/recording/amendments.hpp"
#include "daemon/recording/run_row_json.hpp"
#include "messages/run_log.hpp"

/// Host: the runs there are, and their pages.
namespace isorig::daemon {
namespace {

using nlohmann::json;

/// Newest first; older ones are listed by `isorig runs`.
constexpr std::size_t kRunsListed = 500;
/// A page of a run of days has a few MB.
constexpr std::size_t kRunPageBytes = std::size_t{24} << 20U;

json notes_of(const std::filesystem::path& run) {
  json out = json::array();
  for (const auto& a : shown_amendments(run)) {
    out.push_back({{"at_utc", a.at_utc},
                   {"by", a.by},
                   {"specimen", a.specimen},
                   {"operator", a.operator_name},
                   {"text", a.text}});
  }
  return out;
}

}  // namespace

json Host::runs_json() const {
  auto rows = catalogue_.runs();
  const auto all = rows.size();
  if (rows.size() > kRunsListed) rows.resize(kRunsListed);
  json list = json::array();
  for (const auto& r : rows) {
    std::error_code error;
    json row = row_json(r);
    const auto page = std::filesystem::absolute(r.directory / base::kRunPage, error).lexically_normal();
    row["report"] = std::filesystem::symlink_status(page, error).type() == std::filesystem::file_type::regular;
    row["page"] = page.string();
    row["notes"] = why_not_a_folder(r).empty() ? notes_of(r.directory) : json::array();
    list.push_back(std::move(row));
  }
  return {{"runs", std::move(list)}, {"all", all}};
}

json Host::report_json(const std::string& id) const {
  const auto run = catalogue_.find_run(id);
  if (!run || run->id != id) throw NotThere("there is no run \"" + id + "\" in the catalogue");
  try {
    auto page =
        base::read_text_beneath(options_.runs_root, std::filesystem::path(id) / base::kRunPage, kRunPageBytes + 1);
    if (page.size() > kRunPageBytes) {
      throw std::runtime_error("the page of run " + id + " is too large to be sent: open " +
                               (run->directory / base::kRunPage).string());
    }
    return {{"run", id}, {"page", std::move(page)}};
  } catch (const base::FileError& e) {
    if (!e.missing()) throw;
    throw NotThere("run " + id + " has no page yet: it is written when the run has ended, or by `isorig report " + id +
                   "`");
  }
}

std::string Host::why_not_a_folder(const RunRow& run) {
  std::error_code ignored;
  if (std::filesystem::symlink_status(run.directory, ignored).type() != std::filesystem::file_type::symlink) return {};
  return run.directory.string() + " is a symbolic link: a run that lies elsewhere is looked at there, and not written";
}

}  // namespace isorig::daemon
