#include "webserver/hub.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <boost/asio/io_context.hpp>
#include <filesystem>
#include <fstream>
#include <optional>

namespace isorig::web {
namespace {

using ::testing::HasSubstr;

/// A hub without a daemon: what it does by itself.
class HubTest : public testing::Test {
 protected:
  HubTest() {
    std::filesystem::create_directories(folder_ / "protocols");
    std::ofstream(folder_ / "protocols/p.toml") << "format = \"isorig-protocol/1\"\n";
    HubSettings settings;
    settings.socket = (folder_ / "nobody").string();
    settings.protocols = settings.specimens = settings.models = folder_ / "protocols";
    hub_ = std::make_unique<Hub>(io_, settings);
  }
  ~HubTest() override {
    hub_.reset();
    std::filesystem::remove_all(folder_);
  }
  HubTest(const HubTest&) = delete;
  HubTest& operator=(const HubTest&) = delete;

  /// What it answers, which must not come before the caller, who serves aborts, has gone on.
  template <typename Call>
  Hub::Answer later(Call call) {
    std::optional<Hub::Answer> got;
    call([&](Hub::Answer a) { got = std::move(a); });
    EXPECT_FALSE(got) << "the disk was waited for";
    const auto patience = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (!got && std::chrono::steady_clock::now() < patience) {
      io_.restart();
      io_.run_for(std::chrono::milliseconds(10));
    }
    EXPECT_TRUE(got);
    return got.value_or(Hub::Answer{});
  }

  std::filesystem::path folder_ = std::filesystem::temp_directory_path() / ("isorig-hub-" + random_secret());
  boost::asio::io_context io_{1};
  std::unique_ptr<Hub> hub_;
};

TEST_F(HubTest, FilesAreReadInAnotherThreadThanTheOneThatServesAborts) {
  const auto now = std::chrono::steady_clock::now();
  const auto session = hub_->access().redeem(hub_->access().mint({"Ann", 1, 1, {}, {}}, now), now).value();
  hub_->access().won(session, 1);
  hub_->access().control_is(Access::Control{"Ann", 1});
  const auto perform = [&](const char* verb, const char* body) {
    return later([&](const Hub::Reply& reply) { hub_->perform(verb, session, body, reply); });
  };

  EXPECT_THAT(later([&](const Hub::Reply& reply) { hub_->library(reply); }).text, HasSubstr("\"p.toml\""));
  const auto text = [&](const char* name) {
    return later([&](const Hub::Reply& reply) { hub_->protocol("", name, reply); });
  };
  EXPECT_THAT(text("p.toml").text, HasSubstr("isorig-protocol/1"));
  EXPECT_EQ(text("none.toml").status, 404);
  // A file that is there is sent on to the daemon, which is not there.
  EXPECT_EQ(perform("start", R"({"operator":"Ann","protocol_file":"p.toml","specimen_file":"p.toml"})").status, 502);
  EXPECT_EQ(perform("start", R"({"operator":"Ann","protocol_file":"none.toml","specimen_file":""})").status, 400);
  EXPECT_EQ(perform("note", R"({"run":"r","specimen_file":"p.toml"})").status, 502);
  EXPECT_EQ(perform("note", R"({"run":"r","specimen_file":"none.toml"})").status, 400);
  EXPECT_THAT(perform("twin", R"({"model_file":"p.toml"})").text, HasSubstr("p.toml:"));
  EXPECT_EQ(perform("twin", R"({"model_file":"none.toml"})").status, 400);
}

}  // namespace
}  // namespace isorig::web
