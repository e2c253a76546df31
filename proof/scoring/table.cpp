#include "proof/scoring/table.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/formatted.hpp"
#include "identify/report/page.hpp"

namespace isorig::proof {
namespace {

std::string text(int digits, double value) {
  if (std::isinf(value)) return value < 0.0 ? "-inf" : "inf";  // "-" would say that there is no such number
  if (std::isnan(value)) return "-";
  return base::formatted("%.*f", digits, value);
}

std::string share(const Share& s) {
  if (s.of == 0) return "-";
  const Interval i = wilson(s);
  return std::to_string(s.hits) + "/" + std::to_string(s.of) + " [" + text(0, 100.0 * i.low) + ", " +
         text(0, 100.0 * i.high) + "]";
}

std::string joined(const std::vector<std::string>& words) {
  std::string out;
  for (const std::string& word : words) out += (out.empty() ? "" : " + ") + word;
  return out;
}

struct Row {
  const char* what;
  std::string (*value)(const Score&);
};

constexpr Row kRows[] = {
    {"false alarms on nulls", [](const Score& s) { return share(s.false_alarms); }},
    {"  of those without a trap", [](const Score& s) { return share(s.clean_false_alarms); }},
    {"singles named first", [](const Score& s) { return share(s.first_all); }},
    {"  full size", [](const Score& s) { return share(s.first_full); }},
    {"  half size", [](const Score& s) { return share(s.first_half); }},
    {"  quarter size", [](const Score& s) { return share(s.first_quarter); }},
    {"singles called consistent", [](const Score& s) { return share(s.missed); }},
    {"named first over a background", [](const Score& s) { return share(s.background_first); }},
    {"pairs complete", [](const Score& s) { return share(s.pairs_complete); }},
    {"pairs exact", [](const Score& s) { return share(s.pairs_exact); }},
    {"triples complete", [](const Score& s) { return share(s.triples_complete); }},
    {"triples exact", [](const Score& s) { return share(s.triples_exact); }},
    {"confusable pairs complete", [](const Score& s) { return share(s.confusable_complete); }},
    {"out of catalogue called unknown", [](const Score& s) { return share(s.unknown_called); }},
    {"  or by a name of a part of it", [](const Score& s) { return share(s.unknown_or_half); }},
    {"out of catalogue, wrong name > 0.9", [](const Score& s) { return share(s.unknown_wrong_sure); }},
    {"all cases, wrong name > 0.9", [](const Score& s) { return share(s.wrong_sure); }},
    {"claims > 0.9 that are right", [](const Score& s) { return share(s.sure_right); }},
    {"all cases, cannot judge", [](const Score& s) { return share(s.unjudged); }},
    {"heldout worse than nominal", [](const Score& s) { return share(s.worse); }},
    {"gap closed on heldout, median %", [](const Score& s) { return text(1, 100.0 * s.median_gap); }},
    {"  of the named effects %", [](const Score& s) { return text(1, 100.0 * s.median_gap_named); }},
    {"Brier score of the claims", [](const Score& s) { return text(3, s.brier); }},
    {"expected calibration error", [](const Score& s) { return text(3, s.calibration_error); }},
    {"failed runs", [](const Score& s) { return share(s.failed); }},
    {"time per case, median s", [](const Score& s) { return text(2, s.median_wall_s); }},
    {"CPU time per case, median s", [](const Score& s) { return text(2, s.median_cpu_s); }},
    {"CPU time per case, most s", [](const Score& s) { return text(1, s.most_cpu_s); }},
};

}  // namespace

std::vector<std::vector<std::string>> comparison(std::span<const Score> scores) {
  std::vector<std::vector<std::string>> rows;
  for (const Row& row : kRows) {
    rows.push_back({row.what});
    for (const Score& s : scores) rows.back().push_back(row.value(s));
  }
  return rows;
}

std::string comparison_text(std::span<const Score> scores) {
  std::string out;
  const auto cell = [&out](const std::string& word, std::size_t width, bool left) {
    const std::string pad(word.size() < width ? width - word.size() : 0, ' ');
    out += left ? word + pad : pad + word;
  };
  constexpr std::size_t kFirst = 36;
  const auto width = [](const Score& s) { return std::max<std::size_t>(s.method.size() + 2, 19); };
  cell("", kFirst, true);
  for (const Score& s : scores) cell(s.method, width(s), false);
  out += '\n';
  for (const auto& row : comparison(scores)) {
    cell(row[0], kFirst, true);
    for (std::size_t i = 1; i < row.size(); ++i) cell(row[i], width(scores[i - 1]), false);
    out += '\n';
  }
  return out;
}

std::string table_text(std::span<const Score> scores) {
  std::string out = comparison_text(scores);
  if (scores.empty()) return out;
  out += "\nclaimed by " + scores.front().method + "   claims  mean claim  right\n";
  for (const ReliabilityBin& bin : scores.front().reliability) {
    if (bin.claims > 0)
      out += base::formatted("  %.2f - %.2f %13zu %11.3f %6.3f\n", bin.low, bin.high, bin.claims, bin.mean_claimed,
                             bin.right);
  }
  return out;
}

nlohmann::ordered_json score_json(std::span<const Score> scores) {
  const auto number = [](double v) { return std::isfinite(v) ? nlohmann::ordered_json(v) : nlohmann::ordered_json(); };
  const auto counted = [](const Share& s) {
    const Interval i = wilson(s);
    return nlohmann::ordered_json{{"hits", s.hits}, {"of", s.of}, {"ci95", {i.low, i.high}}};
  };
  nlohmann::ordered_json json{{"format", "isorig-proof-score/1"}, {"methods", nlohmann::ordered_json::array()}};
  for (const Score& s : scores) {
    nlohmann::ordered_json one{{"method", s.method}, {"cases", s.cases}};
    one["false_alarms"] = counted(s.false_alarms);
    one["clean_false_alarms"] = counted(s.clean_false_alarms);
    one["unjudged"] = counted(s.unjudged);
    one["singles_first"] = counted(s.first_all);
    one["singles_first_full"] = counted(s.first_full);
    one["singles_first_half"] = counted(s.first_half);
    one["singles_first_quarter"] = counted(s.first_quarter);
    one["singles_missed"] = counted(s.missed);
    one["background_first"] = counted(s.background_first);
    one["pairs_complete"] = counted(s.pairs_complete);
    one["pairs_exact"] = counted(s.pairs_exact);
    one["triples_complete"] = counted(s.triples_complete);
    one["triples_exact"] = counted(s.triples_exact);
    one["confusable_complete"] = counted(s.confusable_complete);
    one["confusable_exact"] = counted(s.confusable_exact);
    one["unknown_called"] = counted(s.unknown_called);
    one["unknown_or_half"] = counted(s.unknown_or_half);
    one["unknown_wrong_sure"] = counted(s.unknown_wrong_sure);
    one["wrong_sure"] = counted(s.wrong_sure);
    one["sure_right"] = counted(s.sure_right);
    one["heldout_worse"] = counted(s.worse);
    one["failed"] = counted(s.failed);
    one["gap_closed_median"] = number(s.median_gap);
    one["gap_closed_median_named"] = number(s.median_gap_named);
    one["gaps_closed"] = s.gaps;
    one["brier"] = number(s.brier);
    one["expected_calibration_error"] = number(s.calibration_error);
    one["wall_s_median"] = number(s.median_wall_s);
    one["wall_s_most"] = number(s.most_wall_s);
    one["cpu_s_median"] = number(s.median_cpu_s);
    one["cpu_s_most"] = number(s.most_cpu_s);
    for (const ReliabilityBin& bin : s.reliability)
      one["reliability"].push_back({{"low", bin.low},
                                    {"high", bin.high},
                                    {"claims", bin.claims},
                                    {"mean_claimed", bin.mean_claimed},
                                    {"right", bin.right}});
    json["methods"].push_back(std::move(one));
  }
  return json;
}

std::vector<std::vector<std::string>> case_rows(const std::vector<Label>& labels, const std::vector<Outcome>& outcomes,
                                                bool against_recorded_force) {
  std::vector<std::vector<std::string>> rows;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    const Label& label = labels[i];
    const Outcome& outcome = outcomes[i];
    std::vector<std::string> hidden = label.effects;
    for (std::size_t n = 0; n < label.laws.size(); ++n) hidden[n] += " (" + label.laws[n] + ")";
    std::string concealed = hidden.empty() ? "nothing" : joined(hidden);
    if (label.trap != "none") concealed += " (" + label.trap + ")";
    std::string said = outcome.failed ? "failed: " + outcome.why : outcome.verdict;
    for (const Claim& claim : outcome.missing) said += ", " + claim.effect + " " + text(2, claim.probability);
    const double gap = gap_closed(outcome, against_recorded_force ? label.noise_N : 0.0);
    rows.push_back({label.name, label.category, concealed, text(2, label.size), text(1, label.residual_over_noise),
                    said, label.effects.empty() ? "-" : text(1, 100.0 * gap), text(1, outcome.wall_s)});
  }
  return rows;
}

void write_score_report(const std::filesystem::path& folder, const std::string& title, std::span<const Score> scores,
                        const std::vector<std::vector<std::string>>& rows, const std::string& seal) {
  namespace report = identify::report;
  report::Page page("Score", title);
  if (!seal.empty()) page.paragraph("SHA-256 of the labels, published before the tool ran and verified: " + seal);
  page.note(
      "Every case here is simulated, by a rig that shares no stepping code with the tool's catalogue. "
      "Brackets hold 95 % intervals in per cent (Wilson 1927).");
  std::vector<std::string> header{""};
  for (const Score& s : scores) header.push_back(s.method);
  page.heading("Methods");
  page.table(header, comparison(scores));
  page.heading("Calibration");
  report::Figure figure{"reliability", "Claimed probability of each named effect against how often it was right.", {}};
  report::Panel panel;
  panel.x_label = "claimed";
  panel.y_label = "right";
  panel.x_range = {0.0, 1.0};
  panel.y_range = {0.0, 1.05};
  panel.series.push_back({{0.0, 1.0}, {0.0, 1.0}, "perfect", report::Mark::kDashes});
  for (const Score& s : scores) {
    report::Series series;
    series.label = s.method;
    series.mark = report::Mark::kLinePoints;
    for (const ReliabilityBin& bin : s.reliability) {
      if (bin.claims == 0) continue;
      series.x.push_back(bin.mean_claimed);
      series.y.push_back(bin.right);
    }
    if (!series.x.empty()) panel.series.push_back(std::move(series));
  }
  figure.panels.push_back(std::move(panel));
  page.figure(figure);
  page.heading("Cases");
  page.table({"case", "kind", "concealed", "size", "residual / noise", "said", "gap closed %", "s"}, rows,
             "What was concealed, what " + (scores.empty() ? std::string("was") : scores.front().method) + " said.");
  page.write(folder, "report.html");
}

}  // namespace isorig::proof
