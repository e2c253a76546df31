#include "model/words.hpp"

#include <gtest/gtest.h>

#include "cli/screen/live_verdicts.hpp"
#include "model/catalogue.hpp"
#include "webserver/words/diagnosis_words.hpp"
#include "webserver/words/verdicts.hpp"

/// What the page says in the words of the terminal and of the catalogue.
namespace isorig::web {
namespace {

using nlohmann::json;

json link(double bound_us, int lost) {
  return {{"connected", true}, {"clock_ready", true}, {"bound_us", bound_us}, {"repeatability_us", 3.0},
          {"lost", lost},      {"corrupt", 2},        {"reconnects", 1}};
}
json loop(double worst_wakeup_us, int overruns) {
  return {{"ticks", 1000}, {"overruns", overruns}, {"worst_wakeup_us", worst_wakeup_us}, {"worst_run_us", 80.0}};
}

TEST(PageVerdicts, AreThoseOfTheTerminalWithItsWords) {
  const json status{{"loop", loop(1200.0, 0)}, {"frame", link(40.0, 0)}, {"pressure", link(9000.0, 7)}};
  const auto said = verdicts_of(status);
  EXPECT_EQ(said["loop"]["tone"], "warn") << "1.2 ms are fair at the terminal: the page had a cross from 1 ms on";
  EXPECT_EQ(said["loop"]["text"], cli::judge_loop(status["loop"]).text);
  EXPECT_EQ(said["frame"]["tone"], "good");
  EXPECT_EQ(said["pressure"]["tone"], "bad") << "a clock bound of 9 ms: the page had a tick";
  const auto text = said["pressure"]["text"].get<std::string>();
  EXPECT_EQ(text, cli::judge_device(status["pressure"]).text);
  for (const auto* words : {"LOST 7", "corrupt 2", "reconnected 1 times"}) {
    EXPECT_NE(text.find(words), std::string::npos) << text;
  }
}

TEST(PageVerdicts, MissedTicksMatter) {
  // 6 % of all ticks: above cli::kLateShare[1].
  EXPECT_EQ(verdicts_of({{"loop", loop(10.0, 60)}})["loop"]["tone"], "bad");
}

TEST(PageVerdicts, AStatusOfAnotherReleaseHasNone) {
  EXPECT_EQ(verdicts_of({{"frame", {{"connected", "yes"}}}, {"loop", 3}}), json::object());
  EXPECT_EQ(verdicts_of(json::object()), json::object());
}

json list_of(const std::string& effect, const std::string& law, const std::vector<std::string>& numbers) {
  json parameters = json::object();
  for (const auto& name : numbers) parameters[name] = {{"value", 4.2}, {"ci95", {4.0, 4.4}}};
  json missing{{"effect", effect}, {"law", law}, {"parameters", std::move(parameters)}};
  return {{"diagnoses", json::array({json{{"missing", json::array({missing})}}})}};
}

TEST(PageUnits, EachNumberOfEveryEffectHasThatOfItsSheet) {
  for (const auto* physics : model::effects()) {
    for (const auto& law : physics->laws) {
      std::vector<std::string> names;
      for (const auto& p : law.parameters) names.emplace_back(p.name);
      for (const auto& c : law.coefficients) names.emplace_back(c.name);
      auto list = list_of(std::string(physics->name), std::string(law.name), names);
      put_in_words(list);
      const auto& numbers = list["diagnoses"][0]["missing"][0]["parameters"];
      const auto check = [&](std::string_view name, std::string_view unit) {
        EXPECT_EQ(numbers[std::string(name)].value("unit", ""), model::unit_words(unit))
            << physics->name << " " << name;
      };
      for (const auto& p : law.parameters) check(p.name, p.sheet.unit);
      for (const auto& c : law.coefficients) check(c.name, c.sheet.unit);
    }
  }
}

TEST(PageUnits, AnUnknownEffectOrNumberHasNone) {
  auto list = list_of("pressure_coupling", "force", {"force_N_psi", "force_N_psi_2", "other"});
  put_in_words(list);
  const auto& numbers = list["diagnoses"][0]["missing"][0]["parameters"];
  EXPECT_EQ(numbers["force_N_psi"]["unit"], "N/psi");
  EXPECT_EQ(numbers["force_N_psi_2"]["unit"], "N/psi") << "of the second part of its kind";
  EXPECT_FALSE(numbers["other"].contains("unit"));
  EXPECT_EQ(numbers["force_N_psi_2"]["words"], "force 2");
  EXPECT_FALSE(numbers["other"].contains("words"));
  for (auto strange : {json::object(), json{{"diagnoses", 3}}, json{{"diagnoses", {{{"missing", {3}}}}}},
                       list_of("no_such_effect", "", {"force_N"})}) {
    const auto before = strange;
    put_in_words(strange);
    EXPECT_EQ(strange, before);
  }
}

TEST(PageWords, WhatIsSaidOfADiagnosisNamesEffectsAsPeopleDo) {
  json list{{"diagnoses",
             {{{"notes", {"cannot tell coulomb_friction from slack", 3}},
               {"warnings", {"force_N of coulomb_friction"}},
               {"cannot_judge", {{"why", "something speaks for coulomb_friction+slack"}, {"record", "more"}}},
               {"not_modelled", {{"names", {"coulomb_friction"}}, {"why", "it errs"}}},
               {"inseparable", {{{"text", "If coulomb_friction is true"}}}}}}}};
  put_in_words(list);
  const auto& d = list["diagnoses"][0];
  EXPECT_EQ(d["notes"][0], "cannot tell dry friction from slack");
  EXPECT_EQ(d["notes"][1], 3);
  EXPECT_EQ(d["warnings"][0], "force of dry friction");
  EXPECT_EQ(d["cannot_judge"]["why"], "something speaks for dry friction and slack");
  EXPECT_EQ(d["not_modelled"]["names"][0], "coulomb_friction") << "a name, for which the page has words";
  EXPECT_EQ(d["inseparable"][0]["text"], "If dry friction is true");
}

}  // namespace
}  // namespace isorig::web
