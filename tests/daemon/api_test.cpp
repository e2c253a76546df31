#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstring>
#include <nlohmann/json.hpp>
#include <thread>

#include "daemon/api.hpp"
#include "daemon/host.hpp"
#include "recording_rig.hpp"
#include "rig_fixture.hpp"

/// The control API as any client meets it, byte by byte.
namespace isorig::daemon::test {
namespace {

using ::testing::HasSubstr;

struct Answer {
  int status = 0;
  std::string body;
  /// Every answer is JSON with `ok` and `text`, whatever was asked.
  [[nodiscard]] std::string text() const { return nlohmann::json::parse(body).at("text").get<std::string>(); }
};

class ApiTest : public ::testing::Test {
 protected:
  void SetUp() override { serving_ = std::thread([this] { api_.serve(); }); }
  void TearDown() override {
    api_.stop();
    serving_.join();
  }

  Answer request(const std::string& line, const std::string& body = {}, const std::string& headers = {}) {
    const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strcpy(address.sun_path, socket_.c_str());
    EXPECT_EQ(::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    const std::string all = line + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n" + headers +
                            "Content-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body;
    EXPECT_EQ(::send(fd, all.data(), all.size(), MSG_NOSIGNAL), static_cast<ssize_t>(all.size()));
    std::string got;
    char buffer[4096];
    for (ssize_t n = 0; (n = ::read(fd, buffer, sizeof buffer)) > 0;) got.append(buffer, static_cast<std::size_t>(n));
    ::close(fd);
    if (got.size() < 12 || got.find("\r\n\r\n") == std::string::npos) return {};
    return {std::stoi(got.substr(9, 3)), got.substr(got.find("\r\n\r\n") + 4)};
  }

  testing::TemporaryDirectory folder_{"api"};
  std::string socket_ = (folder_.path() / "s").string();
  RigConfig config_ = load_rig(source("config/rigs/sim.toml"));
  VirtualRig rig_{config_};
  Host host_{config_, rig_.core(), rig_.streams, [this] {
               Host::Options o;
               o.runs_root = folder_.path() / "runs";
               return o;
             }()};
  Api api_{host_, socket_, 0600};
  std::thread serving_;
};

TEST_F(ApiTest, EveryRefusalSaysWhatToDo) {
  const auto unknown = request("GET /v1/start");
  EXPECT_EQ(unknown.status, 404);
  EXPECT_THAT(unknown.text(), HasSubstr("POST /v1/start"));
  const auto form = request("POST /v1/start", std::string(9000, ' '), "Content-Type: application/x-www-form-urlencoded\r\n");
  EXPECT_EQ(form.status, 413);
  EXPECT_THAT(form.text(), HasSubstr("application/json"));
  const auto list = request("POST /v1/start", "[]");
  EXPECT_EQ(list.status, 400);
  EXPECT_THAT(list.text(), HasSubstr("JSON object"));
}

TEST_F(ApiTest, NamesAreOneLineOfPlainText) {
  for (const auto* key : {"operator", "protocol_name", "specimen_name"}) {
    const auto answer = request("POST /v1/start", std::string("{\"protocol\":\"x\",\"") + key + "\":\"a\\u001b[31m\"}");
    EXPECT_EQ(answer.status, 400) << key;
    EXPECT_THAT(answer.text(), HasSubstr(std::string("`") + key + "` holds a control character"));
  }
}

TEST_F(ApiTest, BytesThatAreNoUtf8GetAnAnswerAllTheSame) {
  const auto answer = request("POST /v1/start", "{\"protocol\":\"\xff\xfe\"}");
  EXPECT_EQ(answer.status, 400);
  EXPECT_THAT(answer.text(), HasSubstr("the request is not what /v1/start takes"));
}

}  // namespace
}  // namespace isorig::daemon::test
