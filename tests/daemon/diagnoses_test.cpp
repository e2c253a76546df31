#include "daemon/host/diagnoses.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>

#include "recording_rig.hpp"

namespace isorig::daemon {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

constexpr const char* kExperiment = "format = \"isorig-protocol/1\"\nname = \"settle-it\"\n";

class DiagnosesTest : public ::testing::Test {
 protected:
  void write(const std::filesystem::path& file, const std::string& text) const {
    std::filesystem::create_directories((root_ / file).parent_path());
    std::ofstream(root_ / file) << text;
  }
  static json diagnosis() {
    return {{"format", "isorig-diagnosis/1"},
            {"verdict", "missing"},
            {"missing",
             {{{"effect", "coulomb_friction"}, {"probability", 0.91}, {"size_N", 0.2}, {"shape", {{"x", {1, 2, 3}}}}}}},
            {"discernible",
             {{{"effect", "coulomb_friction"}, {"seen_from_N", 0.02}}, {{"effect", "slack"}, {"seen_from_N", 0.5}}}},
            {"data_faults", {1, 2}},
            {"tried", {1, 2, 3}},
            {"warnings", {"mixed"}},
            {"next_experiment", {{"text", "triangles"}, {"duration_s", 28}}}};
  }
  [[nodiscard]] json entry(const std::string& folder) const {
    const auto list = looked_.list();
    for (const auto& e : list["diagnoses"]) {
      if (e["folder"] == folder) return e;
    }
    return nullptr;
  }

  testing::TemporaryDirectory folder_{"diagnoses"};
  std::filesystem::path root_ = folder_.path() / "runs";
  Diagnoses looked_{{root_, root_ / "beside", folder_.path() / "not-there"}};
};

TEST_F(DiagnosesTest, ADiagnosisBesideARunIsListedWithoutItsCurves) {
  write("20260101-run/diagnosis/diagnosis.json", diagnosis().dump());
  write("20260101-run/diagnosis/diagnosis-report.html", "<html>the page</html>");
  write("20260101-run/diagnosis/next_experiment.toml", kExperiment);
  const auto e = entry("20260101-run/diagnosis");
  ASSERT_TRUE(e.is_object());
  EXPECT_EQ(e["kind"], "diagnosis");
  EXPECT_EQ(e["missing"][0]["probability"], 0.91);
  EXPECT_FALSE(e["missing"][0].contains("shape"));
  EXPECT_EQ(e["missing"][0]["discernible"]["seen_from_N"], 0.02);
  EXPECT_EQ(e["data_faults"], 2);
  EXPECT_FALSE(e.contains("tried"));
  EXPECT_EQ(e["experiment"], true);
  ASSERT_EQ(e["pages"].size(), 1U);
  EXPECT_EQ(looked_.page(e["pages"][0]["path"])["page"], "<html>the page</html>");
  EXPECT_EQ(looked_.experiment(e["id"])["protocol"], kExperiment);
}

TEST_F(DiagnosesTest, AnInvestigationIsOneEntryWithItsLastRound) {
  const json whole{{"format", "isorig-investigation/1"},
                   {"outcome", "rounds"},
                   {"text", "Not settled"},
                   {"rig_s", 12.5},
                   {"rounds",
                    {{{"round", 1}, {"next_protocol", "of the first"}},
                     {{"round", 2},
                      {"next_protocol", kExperiment},
                      {"explanations", {{{"effects", "slack"}, {"probability", 0.9}}}}}}}};
  write("inv/investigation.json", whole.dump());
  write("inv/investigation-report.html", "all rounds");
  write("inv/diagnosis.json", diagnosis().dump());
  write("inv/round-2/diagnosis/diagnosis.json", diagnosis().dump());
  write("inv/round-2/diagnosis/diagnosis-report.html", "the last");
  EXPECT_EQ(looked_.list()["diagnoses"].size(), 1U);
  const auto e = entry("inv");
  EXPECT_EQ(e["kind"], "investigation");
  EXPECT_EQ(e["rounds"], 2);
  EXPECT_EQ(e["outcome"], "rounds");
  EXPECT_EQ(e["verdict"], "missing");
  ASSERT_EQ(e["pages"].size(), 2U);
  EXPECT_EQ(looked_.page(e["pages"][1]["path"])["page"], "the last");
  EXPECT_EQ(looked_.experiment(e["id"])["protocol"], kExperiment);
}

TEST_F(DiagnosesTest, OnlyWhatALookFindsIsRead) {
  write("deep/1/2/3/diagnosis.json", diagnosis().dump());  // four folders down
  write("far/diagnosis.json", diagnosis().dump());
  std::filesystem::create_directories(folder_.path() / "elsewhere");
  std::ofstream(folder_.path() / "elsewhere" / "diagnosis.json") << diagnosis().dump();
  std::ofstream(folder_.path() / "secret.toml") << "secret";
  std::filesystem::create_directory_symlink(folder_.path() / "elsewhere", root_ / "link");
  std::filesystem::create_symlink(folder_.path() / "secret.toml", root_ / "far" / "next_experiment.toml");
  std::filesystem::create_symlink(folder_.path() / "secret.toml", root_ / "far" / "diagnosis-report.html");
  const auto list = looked_.list();
  ASSERT_EQ(list["diagnoses"].size(), 1U);
  const auto e = entry("far");
  EXPECT_EQ(e["experiment"], false);
  EXPECT_TRUE(e["pages"].empty());
  EXPECT_THROW((void)looked_.experiment(e["id"]), std::runtime_error);
}

TEST_F(DiagnosesTest, OnlyReportsThatLieInAPlaceAreGivenOut) {
  write("run/report.html", "of the run");
  write("run/out/fv/fv-report.html", "curves");
  write("run/other.html", "secret");
  write("run/.hidden/report.html", "secret");
  write("1/2/3/4/5/6/report.html", "six folders down");
  write("1/2/3/4/5/6/7/report.html", "secret");
  const auto outside = folder_.path() / "elsewhere";
  std::filesystem::create_directories(outside);
  std::ofstream(outside / "report.html") << "secret";
  std::ofstream(root_ / "1" / "fv-report.html") << std::string(Diagnoses::kPageBytes + 1, 'x');
  std::filesystem::create_directory_symlink(outside, root_ / "link");
  std::filesystem::create_symlink(outside / "report.html", root_ / "run" / "diagnosis-report.html");
  std::filesystem::create_directory(root_ / "run" / "campaign-report.html");
  ASSERT_EQ(::mkfifo((root_ / "run" / "investigation-report.html").c_str(), 0600), 0);  // it would be waited for
  const auto given = [this](const std::filesystem::path& path) -> std::string {
    try {
      return looked_.page(path.string())["page"];
    } catch (const std::runtime_error& e) {
      return std::string("refused: ") + e.what();
    }
  };
  EXPECT_EQ(given(root_ / "run/report.html"), "of the run");
  EXPECT_EQ(given(root_ / "run/out/fv/fv-report.html"), "curves");
  EXPECT_EQ(given(root_ / "1/2/3/4/5/6/report.html"), "six folders down");
  for (const std::filesystem::path& path :
       {root_ / "run/other.html", root_ / "run/.hidden/report.html", root_ / "1/2/3/4/5/6/7/report.html",
        outside / "report.html", root_ / "../elsewhere/report.html", root_ / "run/../../elsewhere/report.html",
        root_ / "run/./report.html", root_ / "link/report.html", root_ / "run/diagnosis-report.html",
        root_ / "run/campaign-report.html", root_ / "run/investigation-report.html", root_ / "1/fv-report.html",
        std::filesystem::path("run/report.html"), std::filesystem::path("report.html"), std::filesystem::path(""),
        std::filesystem::path(root_.string() + "/run" + std::string(1, '\0') + "/report.html"),
        root_ / std::string(5000, 'x') / "report.html"}) {
    EXPECT_THAT(given(path), ::testing::StartsWith("refused: ")) << path;
  }
}

TEST_F(DiagnosesTest, APlaceThatIsALinkIsKnownByBothNames) {
  write("run/report.html", "of the run");
  const auto link = folder_.path() / "link";
  std::filesystem::create_directory_symlink(root_, link);
  const Diagnoses looked({link});
  EXPECT_EQ(looked.page((link / "run/report.html").string())["page"], "of the run");
  EXPECT_EQ(looked.page((std::filesystem::canonical(root_) / "run/report.html").string())["page"], "of the run");
}

TEST_F(DiagnosesTest, WhatCannotBeReadIsThereWithTheReason) {
  write("cut/diagnosis.json", "{\"format\": ");
  write("other/diagnosis.json", R"({"format": "something"})");
  write("empty/investigation.json", R"({"format": "isorig-investigation/1"})");
  EXPECT_THAT(entry("cut").value("wrong", ""), HasSubstr("not valid JSON"));
  EXPECT_THAT(entry("other").value("wrong", ""), HasSubstr("it is no isorig-diagnosis/1"));
  EXPECT_THAT(entry("empty").value("wrong", ""), HasSubstr("`outcome` has to be there"));
  // A FIFO would be waited for.
  std::filesystem::create_directories(root_ / "pipe");
  ASSERT_EQ(::mkfifo((root_ / "pipe" / "diagnosis.json").c_str(), 0600), 0);
  EXPECT_TRUE(entry("pipe").is_null());
}

TEST_F(DiagnosesTest, WhatHasAnotherShapeIsThereWithTheReasonAndInNobodysWay) {
  const std::vector<std::pair<const char*, json>> wrong{
      {"verdict", 5},
      {"cannot_judge", {{"why", "no motion"}}},
      {"missing", "much"},
      {"missing", {{{"effect", "slack"}}}},
      {"missing", {{{"effect", "slack"}, {"probability", 0.9}, {"parameters", {{"k", 1}}}}}},
      {"missing", {{{"effect", "slack"}, {"probability", 1}, {"parameters", {{"k", {{"value", 1}, {"ci95", {1}}}}}}}}},
      {"discernible", {{{"effect", "slack"}, {"nearest", 1}}}},
      {"alternatives", {{{"effects", "slack"}, {"probability", 0.1}}}},
      {"inseparable", {"pair"}},
      {"not_modelled", {{"names", "slack"}, {"why", "worse"}}},
      {"described", {"position"}},
      {"warnings", {1}},
      {"notes", "one"},
      {"data_faults", 3},
      {"next_experiment", {{"text", "triangles"}, {"duration_s", "long"}}}};
  for (std::size_t i = 0; i < wrong.size(); ++i) {
    auto one = diagnosis();
    one[wrong[i].first] = wrong[i].second;
    write("d" + std::to_string(i) + "/diagnosis.json", one.dump());
  }
  for (std::size_t i = 0; i < wrong.size(); ++i) {
    const auto e = entry("d" + std::to_string(i));
    EXPECT_THAT(e.value("wrong", ""), HasSubstr("diagnosis.json: `" + std::string(wrong[i].first))) << wrong[i].second;
    EXPECT_FALSE(e.contains("missing"));
  }
  EXPECT_THAT(entry("d4").value("wrong", ""), HasSubstr("`missing[0].parameters.k` has to be an object"));
  write("i/investigation.json",
        R"({"format":"isorig-investigation/1","outcome":"settled","text":"","rig_s":1,"rounds":[{"explanations":5}]})");
  EXPECT_THAT(entry("i").value("wrong", ""), HasSubstr("`rounds[0].explanations` has to be a list"));
  // What is not finite is null in JSON, and shown as such.
  auto whole = diagnosis();
  whole["missing"][0]["parameters"] = {{"k", {{"value", 1}, {"ci95", {0, nullptr}}}}};
  write("whole/diagnosis.json", whole.dump());
  EXPECT_FALSE(entry("whole").contains("wrong")) << entry("whole")["wrong"];
}

TEST_F(DiagnosesTest, NestingDeeperThanAStackIsRefused) {
  // 4 MiB of brackets, alone and closed as the value of a key of a diagnosis.
  const std::size_t deep = std::size_t{4} << 20U;
  write("brackets/diagnosis.json", std::string(deep, '['));
  write("closed/diagnosis.json",
        R"({"format":"isorig-diagnosis/1","verdict":)" + std::string(deep / 2, '[') + std::string(deep / 2, ']') + "}");
  auto whole = diagnosis();
  whole["fit"] = json::parse(std::string(60, '[') + std::string(60, ']'));
  write("flat/diagnosis.json", whole.dump());
  EXPECT_THAT(entry("brackets").value("wrong", ""), HasSubstr("nested deeper than 64 levels"));
  EXPECT_THAT(entry("closed").value("wrong", ""), HasSubstr("nested deeper than 64 levels"));
  EXPECT_FALSE(entry("flat").contains("wrong"));
}

TEST_F(DiagnosesTest, ManyEntriesInOnePlaceDoNotHideAnother) {
  for (int run = 0; run < 20; ++run) write("run-" + std::to_string(run) + "/recording.toml", "");
  const auto other = folder_.path() / "other";
  std::filesystem::create_directories(other / "mine");
  std::ofstream(other / "mine" / "diagnosis.json") << diagnosis().dump();
  const auto list = Diagnoses({root_, other}, 10).list();
  EXPECT_EQ(list["cut"], true);
  ASSERT_EQ(list["all"], 1);
  EXPECT_EQ(list["diagnoses"][0]["folder"], "mine");
  EXPECT_EQ(Diagnoses({root_, other}, 40).list()["cut"], false);
}

TEST_F(DiagnosesTest, APlaceInAnotherIsNotListedTwice) {
  write("beside/one/diagnosis.json", diagnosis().dump());
  EXPECT_EQ(looked_.list()["all"], 1);
}

}  // namespace
}  // namespace isorig::daemon
