#include "daemon/host/api.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>
#include <vector>

#include "daemon/host/corrections.hpp"
#include "daemon/host/host.hpp"
#include "daemon/recording/amendments.hpp"
#include "daemon/recording/catalogue.hpp"
#include "daemon/rig/specimen.hpp"
#include "recording_rig.hpp"
#include "rig_fixture.hpp"

/// The control API as any client meets it, byte by byte.
namespace isorig::daemon::test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

struct Answer {
  int status = 0;
  std::string body;
  /// Every answer is JSON with `ok` and `text`, whatever was asked.
  [[nodiscard]] std::string text() const { return nlohmann::json::parse(body).at("text").get<std::string>(); }
};

/// A connection of its own, byte by byte.
class Connection {
 public:
  explicit Connection(const std::string& socket) : fd_(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strcpy(address.sun_path, socket.c_str());
    connected_ = ::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  }
  ~Connection() { ::close(fd_); }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  [[nodiscard]] bool connected() const { return connected_; }
  bool send(const std::string& bytes) const {
    return ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(bytes.size());
  }
  /// Until the server closes.
  [[nodiscard]] std::string rest() const {
    std::string got;
    char buffer[4096];
    for (ssize_t n = 0; (n = ::read(fd_, buffer, sizeof buffer)) > 0;) got.append(buffer, static_cast<std::size_t>(n));
    return got;
  }
  /// Until `text` has come; what follows is not waited for.
  [[nodiscard]] std::string until(const std::string& text) const {
    std::string got;
    char buffer[4096];
    ssize_t n = 0;
    while (got.find(text) == std::string::npos && (n = ::read(fd_, buffer, sizeof buffer)) > 0) {
      got.append(buffer, static_cast<std::size_t>(n));
    }
    return got;
  }

 private:
  int fd_;
  bool connected_ = false;
};

class ApiTest : public ::testing::Test {
 protected:
  void SetUp() override {
    threads_.emplace_back([this] { api_.serve(); });
    threads_.emplace_back([this] { api_.serve_stops(); });
    threads_.emplace_back([this] { api_.work(); });
    threads_.emplace_back([this] {
      while (!done_) {
        rig_.tick();
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    });
  }
  void TearDown() override {
    api_.stop();
    done_ = true;
    for (auto& t : threads_) t.join();
  }

  Answer request(const std::string& line, const std::string& body = {}, const std::string& headers = {},
                 bool stops = false) {
    return send(line + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n" + headers +
                    "Content-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body,
                stops);
  }
  Answer send(const std::string& bytes, bool stops = false) const {
    const Connection connection(stops ? socket_ + ".stop" : socket_);
    EXPECT_TRUE(connection.connected());
    (void)connection.send(bytes);
    const auto got = connection.rest();
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
  std::mutex audit_mutex_;
  std::vector<std::string> audit_;
  Api api_{host_, socket_, 0600, [this](const std::string& line) {
             const std::lock_guard hold(audit_mutex_);
             audit_.push_back(line);
           }};
  std::vector<std::thread> threads_;
  std::atomic<bool> done_{false};
};

TEST_F(ApiTest, EveryRefusalSaysWhatToDo) {
  const auto unknown = request("GET /v1/stat");
  EXPECT_EQ(unknown.status, 404);
  EXPECT_THAT(unknown.text(), HasSubstr("POST /v1/start"));
  const auto method = request("GET /v1/start");
  EXPECT_EQ(method.status, 405);
  EXPECT_THAT(method.text(), HasSubstr("has to be POST"));
  const auto both = request("DELETE /v1/calibrations");
  EXPECT_EQ(both.status, 405);
  EXPECT_THAT(both.text(), HasSubstr("GET or POST"));
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

TEST_F(ApiTest, MarksThatTurnTextAroundAreNoPlainText) {
  EXPECT_EQ(request("POST /v1/start", "{\"protocol\":\"x\",\"operator\":\"a\\u202eb\"}").status, 400);
  EXPECT_THAT(request("POST /v1/start", "{\"protocol\":\"x\",\"operator\":\"J\u00f6rg\"}").text(),
              Not(HasSubstr("control character")));
}

TEST_F(ApiTest, BytesThatAreNoUtf8GetAnAnswerAllTheSame) {
  const auto answer = request("POST /v1/start", "{\"protocol\":\"\xff\xfe\"}");
  EXPECT_EQ(answer.status, 400);
  EXPECT_THAT(answer.text(), HasSubstr("the request is not what /v1/start takes"));
}

TEST_F(ApiTest, WordsThatNobodyReadsAreRefused) {
  const auto typo = request("POST /v1/start", R"({"protocol":"x","protcol_name":"y"})");
  EXPECT_EQ(typo.status, 400);
  EXPECT_THAT(typo.text(), HasSubstr("unknown key `protcol_name`; did you mean `protocol_name`?"));
  EXPECT_THAT(request("POST /v1/start", R"({"protocol":"x","speed":2})").text(),
              HasSubstr("unknown key `speed`; known here"));
  for (const auto* body : {"", "{", "{}", R"({"protocol":3})"}) {
    const auto wrong = request("POST /v1/start", body);
    EXPECT_EQ(wrong.status, 400) << body;
    EXPECT_THAT(wrong.text(), Not(HasSubstr("json.exception"))) << body;
  }
  EXPECT_EQ(request("GET /v1/events?after=-1").status, 400);
  EXPECT_EQ(request("GET /v1/events?after=1x").status, 400);
  EXPECT_EQ(request("GET /v1/events?after=1").status, 200);
  EXPECT_EQ(request("GET /v1/readings?window_s=2x").status, 400);
  EXPECT_EQ(request("GET /v1/readings?window_s=2").status, 200);
}

TEST_F(ApiTest, AKeyThatStandsTwiceOrAQueryThatNobodyReadsIsRefused) {
  // Of two values nobody knows which one was meant; a stop is taken with any.
  const auto again = request("GET /v1/readings?window_s=1&window_s=2");
  EXPECT_EQ(again.status, 400);
  EXPECT_THAT(again.text(), HasSubstr("`window_s` stands in the query twice"));
  EXPECT_EQ(request("GET /v1/readings?window_s=1&window%5Fs=1").status, 400) << "as it is decoded";
  EXPECT_NE(request("POST /v1/abort?a=1&a=2", "{}").status, 400);
  const auto twice = request("POST /v1/setup", R"({"off":true,"off":false})");
  EXPECT_EQ(twice.status, 400);
  EXPECT_THAT(twice.text(), HasSubstr("`off` stands there twice"));
  EXPECT_THAT(request("POST /v1/start", R"({"protocol":{"a":1,"b":{"a":1},"a":2}})").text(), HasSubstr("twice"));
  EXPECT_THAT(request("POST /v1/start", R"({"protocol":[{"a":1},{"a":2}]})").text(), HasSubstr("has to be a text"));
  EXPECT_THAT(request("GET /v1/events?afer=1").text(), HasSubstr("`after` only, and not `afer`"));
  EXPECT_EQ(request("GET /v1/status?x").status, 400);
  EXPECT_EQ(request("POST /v1/abort?x=1").status, 200) << "a stop is a stop";
}

/// What is parsed in the thread of the connections is short and flat: 4 MiB of brackets kept it from an abort for 0.6
/// s.
TEST_F(ApiTest, LongAndDeepBodiesAreRefusedBeforeTheyAreRead) {
  const std::string deep = R"({"off":)" + std::string(1'000'000, '[') + std::string(1'000'000, ']') + "}";
  const auto began = std::chrono::steady_clock::now();
  for (const auto* call : {"POST /v1/setup", "POST /v1/jog", "POST /v1/accept-rig"}) {
    const auto answer = request(call, deep);
    EXPECT_EQ(answer.status, 400) << call;
    EXPECT_THAT(answer.text(), HasSubstr("at most 4096")) << call;
  }
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(5));
  EXPECT_THAT(request("POST /v1/setup", R"({"off":[[[[[[[[[]]]]]]]]]})").text(), HasSubstr("nested deeper than 8"));
  EXPECT_THAT(request("POST /v1/start", deep).text(), HasSubstr("nested deeper than 8"));
  EXPECT_THAT(request("POST /v1/start", R"({"protocol":"[[[[[[[[[[\"[["})").text(), Not(HasSubstr("nested")));
}

TEST(Correction, WhatIsNotOnePlainLineIsNotStored) {
  const testing::TemporaryDirectory folder("note");
  Catalogue catalogue(folder.path());
  RunRow run;
  run.id = "run";
  run.operator_name = "old\x1b[31m";  // as an earlier version stored it
  run.directory = folder.path() / "run";
  std::filesystem::create_directories(run.directory);
  for (const auto field : {&Correction::by, &Correction::operator_name, &Correction::text}) {
    Correction c;
    c.text = "a remark";
    c.*field = "x\x1b[31m";
    EXPECT_THAT([&] { (void)amend_run(catalogue, run, c); },
                ::testing::ThrowsMessage<std::runtime_error>(HasSubstr("\"x\\u001b[31m\" holds a control character")));
  }
  Correction nobody;
  nobody.operator_name = "  ";
  EXPECT_THAT([&] { (void)amend_run(catalogue, run, nobody); },
              ::testing::ThrowsMessage<std::runtime_error>(HasSubstr("the operator's name is blank")));
  EXPECT_TRUE(read_amendments(run.directory).empty());
  Correction c;
  c.operator_name = "Jörg";
  EXPECT_EQ(amend_run(catalogue, run, c), "run run is noted: operator Jörg (was old\\u001b[31m)");
}

TEST(Correction, KeepsTheWholeFileOfTheSpecimen) {
  const testing::TemporaryDirectory folder("note");
  Catalogue catalogue(folder.path());
  RunRow run;
  run.id = "run";
  run.directory = folder.path() / "run";
  std::filesystem::create_directories(run.directory);
  Correction c;
  c.specimen_name = "other.toml";
  const std::string file = load_specimen(test::source("config/specimens/control2.toml")).text;
  c.specimen_text = file;
  (void)amend_run(catalogue, run, c);
  c = {};
  c.text = "a remark";
  (void)amend_run(catalogue, run, c);
  const auto amendments = read_amendments(run.directory);
  ASSERT_EQ(amendments.size(), 2U);
  ASSERT_EQ(last_of_specimen(amendments), &amendments[0]);
  EXPECT_EQ(amendments[0].specimen_file, file);
}

/// What `curl -X POST` sends (RFC 9112, 6.3: no length is no body).
TEST_F(ApiTest, APostWithoutALengthHasAnEmptyBody) {
  for (const auto* verb : {"abort", "pause", "resume", "reset", "seal"}) {
    const Connection connection(socket_);
    ASSERT_TRUE(
        connection.send(std::string("POST /v1/") + verb + " HTTP/1.1\r\nHost: localhost\r\nAccept: */*\r\n\r\n"));
    const auto got = connection.until("}");
    const bool vents = std::string(verb) == "abort";  // whatever the state
    EXPECT_THAT(got, HasSubstr(vents ? "HTTP/1.1 200" : "HTTP/1.1 409")) << verb;
    EXPECT_THAT(got, HasSubstr(vents ? "now " : "the rig is")) << verb;
  }
}

TEST_F(ApiTest, BodiesAreLimitedInEveryCoding) {
  EXPECT_EQ(send("POST /v1/start HTTP/1.1\r\nHost: x\r\nConnection: close\r\nContent-Length: 5000000\r\n\r\n").status,
            413);
  const auto chunked = send("POST /v1/start HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n400\r\n" +
                            std::string(0x400, ' ') + "\r\n");
  EXPECT_EQ(chunked.status, 411);
  EXPECT_THAT(chunked.text(), HasSubstr("Content-Length"));
  EXPECT_EQ(send("GET /v1/status HTTP/1.1\r\nX: " + std::string(20'000, 'x') + "\r\n\r\n").status, 431);
  EXPECT_EQ(send("no HTTP at all\r\n\r\n").status, 400);
}

TEST_F(ApiTest, AHeaderHasADeadlineAsAWhole) {
  const Connection dripping(socket_);
  const auto began = std::chrono::steady_clock::now();
  while (dripping.send("X")) std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(20));
}

/// Connections that say nothing, that stop in the middle of a header, and that never take their answers.
TEST_F(ApiTest, NoCrowdDelaysAnAbort) {
  for (const bool stops : {false, true}) {
    std::vector<std::unique_ptr<Connection>> crowd;
    double worst_ms = 0.0;
    for (int i = 0; i < 300; ++i) {
      crowd.push_back(std::make_unique<Connection>(socket_));
      crowd.push_back(std::make_unique<Connection>(socket_ + ".stop"));
      for (const auto& c : {crowd[crowd.size() - 2].get(), crowd.back().get()}) {
        if (i % 3 == 1) (void)c->send("POST /v1/abort HTTP/1.1\r\nHo");
        if (i % 3 == 2) (void)c->send("GET /v1/status HTTP/1.1\r\nHost: x\r\n\r\n");
      }
      if (i % 10 != 9) continue;
      const auto began = std::chrono::steady_clock::now();
      const auto aborted = request("POST /v1/abort", "", "", stops);
      worst_ms = std::max(worst_ms,
                          std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - began).count());
      EXPECT_EQ(aborted.status, 200) << i;
    }
    std::printf("  abort among up to %zu hostile connections, %s: worst %.1f ms\n", crowd.size(),
                stops ? "stop socket" : "main socket", worst_ms);
    EXPECT_LT(worst_ms, 1000.0);
  }
}

TEST_F(ApiTest, TheOneThatWaitsLongestMakesRoom) {
  const Connection first(socket_);
  std::vector<std::unique_ptr<Connection>> more;
  for (int i = 0; i < 70; ++i) more.push_back(std::make_unique<Connection>(socket_));
  EXPECT_THAT(first.rest(), HasSubstr("503"));
}

TEST_F(ApiTest, TheStopSocketTakesStopsAndStatusAlone) {
  EXPECT_EQ(request("GET /v1/status", "", "", true).status, 200);
  EXPECT_EQ(request("POST /v1/abort", "", "", true).status, 200);
  EXPECT_EQ(request("POST /v1/pause", "", "", true).status, 409);
  for (const auto* other : {"POST /v1/start", "POST /v1/resume", "POST /v1/reset", "GET /v1/events"}) {
    const auto refused = request(other, "", "", true);
    EXPECT_EQ(refused.status, 404) << other;
    EXPECT_THAT(refused.text(), HasSubstr("without .stop"));
  }
  EXPECT_TRUE(std::filesystem::exists(socket_ + ".stop"));
}

TEST_F(ApiTest, EveryCommandIsNotedWithItsSender) {
  (void)request("POST /v1/abort");
  (void)request("POST /v1/start", "{}");
  const std::lock_guard hold(audit_mutex_);
  ASSERT_EQ(audit_.size(), 2U);
  const auto who = "by uid " + std::to_string(::getuid()) + " (process " + std::to_string(::getpid()) + "): ";
  EXPECT_THAT(audit_[0], HasSubstr("abort " + who + "now "));
  EXPECT_THAT(audit_[1], HasSubstr("start " + who + "the request is not what"));
}

}  // namespace
}  // namespace isorig::daemon::test
