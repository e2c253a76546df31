#include <iostream>
#include <memory>
#include <optional>
#include <string>

#include "base/printable.hpp"
#include "cli/command.hpp"
#include "cli/screen/progress.hpp"
#include "daemon/host/audit_log.hpp"
#include "daemon/host/paths.hpp"

/// audit: which commands the daemon was given, by whom, and what came of them.
namespace isorig::cli {
namespace {

struct AuditOptions {
  std::string runs = daemon::default_catalogue().string();
  std::size_t last = 50;
  bool all = false, json = false;
};

/// "ann", or for a page "Ann (ann) by isorig-web": who it was for, and who spoke.
std::string who_text(const nlohmann::json& line) {
  const auto user = line.value("user", "?");
  const auto page = line.find("for");
  if (page == line.end() || !page->is_object()) return user;
  return page->value("name", "?") + " (" + page->value("user", "?") + ") by " + user;
}

void print(const nlohmann::json& line) {
  if (const auto lost = line.value("lost_before", std::uint64_t{0}); lost > 0)
    std::cout << "  " << lost << " commands are missing here: the disk did not take them\n";
  const auto arguments = line.value("arguments", "");
  std::cout << base::printable(line.value("utc", "?") + "  " + who_text(line) + "  " + line.value("verb", "?") +
                               (arguments.empty() ? "" : " " + arguments) + "  " +
                               (line.value("ok", false) ? "" : std::to_string(line.value("status", 0)) + " ") +
                               line.value("outcome", ""))
            << '\n';
}

int audit(const AuditOptions& o) {
  std::optional<Progress> progress(std::in_place, "audit");
  const auto lines = daemon::read_audit(o.runs, o.all ? std::string::npos : o.last,
                                        [&](double done) { progress->at(done, "reading"); });
  progress.reset();
  if (o.json) {
    std::cout << nlohmann::json(lines).dump(2, ' ', false, nlohmann::json::error_handler_t::replace) << '\n';
    return kOk;
  }
  for (const auto& line : lines) {
    try {
      print(line);
    } catch (const nlohmann::json::exception&) {
      std::cout << "  a line that is not the daemon's: " << base::printable(line.dump()) << '\n';
    }
  }
  if (lines.empty()) std::cout << "no commands yet\n";
  return kOk;
}

Command add_audit(CLI::App& app) {
  auto o = std::make_shared<AuditOptions>();
  auto* sub = app.add_subcommand("audit", "Which commands the daemon was given, by whom, and what came of them");
  sub->add_option("--runs", o->runs, "Where runs are kept; the log lies beside them")->capture_default_str();
  auto* last = sub->add_option("--last", o->last, "How many of the newest")->capture_default_str();
  sub->add_flag("--all", o->all, "All that are kept")->excludes(last);
  sub->add_flag("--json", o->json, "For scripts: everything, as JSON");
  return {sub, [o] { return audit(*o); }};
}

const Registration kAudit(43, add_audit);

}  // namespace
}  // namespace isorig::cli
