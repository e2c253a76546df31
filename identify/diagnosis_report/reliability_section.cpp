#include <algorithm>
#include <map>

#include "identify/diagnose/reliability/reliability.hpp"
#include "identify/diagnosis_report/argument.hpp"
#include "model/words.hpp"

namespace isorig::identify {
namespace {

using model::effect_words;
using model::explanation_words;

/// "dry friction 5 times, play once": what the search named of the recordings of one row.
std::string counted(const std::map<std::string, int>& names) {
  std::string out;
  for (const auto& [name, times] : names)
    out += (out.empty() ? "" : ", ") + effect_words(name) +
           (times == 1 ? " once" : " " + std::to_string(times) + " times");
  return out.empty() ? "-" : out;
}

/// Recordings of one truth, with the same effect withheld.
struct Row {
  int simulated = 0, unknown = 0, failed = 0;
  std::map<std::string, int> right, wrong;
};

}  // namespace

void add_reliability(report::Page& page, const Argument& a) {
  const std::optional<Reliability>& reliability = a.study.diagnosis.reliability;
  if (!reliability) return;
  page.heading("How often such names are right");
  page.paragraph(
      "Recordings of the same motion were simulated from the most probable explanations and from the given model, each "
      "as often as the others, with numbers drawn from their uncertainty, the noise of these recordings and what the "
      "chosen explanation leaves; they were diagnosed as this one was. From some of them the search was not given one "
      "of "
      "the effects: physics that it does not know.");
  std::map<std::pair<std::string, std::string>, Row> rows;
  for (const Rehearsal& one : reliability->rehearsals) {
    Row& row = rows[{one.truth, one.withheld}];
    ++row.simulated;
    if (one.verdict == Verdict::kUnknownPhysics) ++row.unknown;
    if (!one.failed.empty()) ++row.failed;
    for (const Claim& claim : one.claims) ++(claim.right ? row.right : row.wrong)[claim.effect];
  }
  std::vector<std::vector<std::string>> table;
  table.reserve(rows.size());
  for (const auto& [of, row] : rows)
    table.push_back({explanation_words(of.first), of.second.empty() ? "-" : effect_words(of.second),
                     std::to_string(row.simulated), counted(row.right), counted(row.wrong),
                     std::to_string(row.unknown) +
                         (row.failed > 0 ? " (" + std::to_string(row.failed) + " not diagnosed)" : std::string())});
  page.table({"simulated from", "not given to the search", "recordings", "named rightly", "named wrongly",
              "told to hold unknown physics"},
             table);
  page.list(reliability_text(*reliability));
}

}  // namespace isorig::identify
