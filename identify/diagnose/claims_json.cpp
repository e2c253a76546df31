#include "identify/diagnose/claims_json.hpp"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

namespace isorig::identify {

using nlohmann::ordered_json;

namespace {

constexpr std::array kVerdicts{Verdict::kConsistent, Verdict::kMissingPhysics, Verdict::kUnknownPhysics,
                               Verdict::kCannotJudge};

Rehearsal rehearsal_from(const ordered_json& json) {
  Rehearsal one;
  one.truth = json.at("truth").get<std::string>();
  one.withheld = json.at("withheld").get<std::string>();
  one.failed = json.at("failed").get<std::string>();
  const auto verdict = std::ranges::find(kVerdicts, json.at("verdict").get<std::string>(),
                                         [](Verdict v) { return std::string(name_of(v)); });
  if (verdict == kVerdicts.end()) throw ordered_json::other_error::create(501, "a verdict that is none", nullptr);
  one.verdict = *verdict;
  for (const ordered_json& claim : json.at("claims"))
    one.claims.push_back({claim.at("effect").get<std::string>(), claim.at("promised").get<double>(),
                          claim.at("right").get<bool>(), claim.at("refused").get<bool>()});
  return one;
}

ordered_json rehearsals_json(const std::vector<Rehearsal>& rehearsals) {
  ordered_json list = ordered_json::array();
  for (const Rehearsal& one : rehearsals) {
    ordered_json claims = ordered_json::array();
    for (const Claim& claim : one.claims)
      claims.push_back(
          {{"effect", claim.effect}, {"promised", claim.promised}, {"right", claim.right}, {"refused", claim.refused}});
    list.push_back({{"truth", one.truth},
                    {"withheld", one.withheld},
                    {"verdict", name_of(one.verdict)},
                    {"claims", std::move(claims)},
                    {"failed", one.failed}});
  }
  return list;
}

ordered_json sureness_json(const std::optional<Sureness>& sureness) {
  if (!sureness) return nullptr;
  return {{"value", sureness->value},
          {"ci95", {sureness->low95, sureness->high95}},
          {"claims", sureness->claims},
          {"right", sureness->right}};
}

}  // namespace

ordered_json reliability_json(const Reliability& reliability) {
  return {{"sureness", sureness_json(reliability.beside_nothing)},
          {"sureness_beside_unknown", sureness_json(reliability.beside_unknown)},
          {"simulated", rehearsals_json(reliability.rehearsals)}};
}

ordered_json name_check_json(const std::vector<Rehearsal>& rehearsals, const std::string& of) {
  return {{"format", kNameCheckFormat}, {"of", of}, {"rehearsals", rehearsals_json(rehearsals)}};
}

std::optional<std::vector<Rehearsal>> rehearsals_of(const std::string& text, const std::string& of) {
  try {
    const ordered_json json = ordered_json::parse(text);
    if (json.at("format") != kNameCheckFormat || json.at("of") != of) return std::nullopt;
    std::vector<Rehearsal> out;
    for (const ordered_json& one : json.at("rehearsals")) out.push_back(rehearsal_from(one));
    return out;
  } catch (const ordered_json::exception&) {
    return std::nullopt;
  }
}

}  // namespace isorig::identify
