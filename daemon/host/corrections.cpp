#include "daemon/host/corrections.hpp"

#include <stdexcept>
#include <utility>

#include "base/blank.hpp"
#include "base/printable.hpp"
#include "daemon/recording/amendments.hpp"
#include "daemon/rig/specimen.hpp"

namespace isorig::daemon {

std::string amend_run(Catalogue& catalogue, const RunRow& run, const Correction& c) {
  for (const auto& [what, value] : {std::pair<const char*, const std::string&>{"name of who notes it", c.by},
                                    {"operator's name", c.operator_name},
                                    {"remark", c.text}}) {
    if (base::printable(value) != value) {
      throw std::runtime_error("the " + std::string(what) + " \"" + base::printable(value) +
                               "\" holds a control character, or a mark that hides or turns text; one line of plain "
                               "text is needed");
    }
  }
  if (!c.operator_name.empty() && base::is_blank(c.operator_name))
    throw std::runtime_error("the operator's name is blank; name somebody, or leave it out");
  Amendment a{utc_now(), c.by, {}, c.operator_name, c.text, c.specimen_text};
  double rest_length_mm = 0.0;
  if (!c.specimen_text.empty()) {
    const auto specimen = parse_specimen(c.specimen_text, c.specimen_name);
    a.specimen = specimen.name;
    rest_length_mm = specimen.rest_length_mm;
  }
  if (a.specimen.empty() && a.operator_name.empty() && a.text.empty()) {
    throw std::runtime_error("nothing to note: name a specimen, an operator or a text");
  }
  // The trace first: a catalogue that says otherwise than the recording has to have its reason beside it.
  append_amendment(run.directory, a);
  catalogue.amend(run.id, a.specimen, rest_length_mm, a.operator_name);
  std::string said = "run " + run.id + " is noted";
  if (!a.specimen.empty()) said += ": specimen " + a.specimen + " (was " + run.specimen + ")";
  if (!a.operator_name.empty())
    said += ": operator " + a.operator_name + (run.operator_name.empty() ? "" : " (was " + run.operator_name + ")");
  return base::printable(said);  // what is stored already may be older than this rule
}

}  // namespace isorig::daemon
