#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "daemon/host/http_server.hpp"
#include "daemon/host/unix_listener.hpp"
#include "recording_rig.hpp"

/// What one client can cost the others: bounds in time, bytes and number, with the limits of a server that is
/// impatient.
namespace isorig::daemon::test {
namespace {

using ::testing::HasSubstr;
using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr milliseconds kHeader{300}, kBody{500}, kAnswer{500};
constexpr std::size_t kLongAnswer = std::size_t{8} << 20U;  // more than a socket's buffers take

class ApiLimitsTest : public ::testing::Test {
 protected:
  ApiLimitsTest() {
    HttpServer::Limits limits;
    limits.connections = 8;
    limits.header_bytes = 1024;
    limits.body_bytes = 200'000;
    limits.all_bodies_bytes = 300'000;
    limits.header = kHeader;
    limits.body = kBody;
    limits.answer = kAnswer;
    server_ = std::make_unique<HttpServer>(
        listener_.fd(), limits,
        [](const HttpRequest& q, const HttpServer::Reply& reply) {
          reply({200, q.path == "/long" ? std::string(kLongAnswer, 'x') : "{}"});
        },
        [](int status, const std::string& why) {
          return HttpAnswer{status, why};
        });
    thread_ = std::thread([this] { server_->run(); });
  }
  ~ApiLimitsTest() override {
    server_->stop();
    thread_.join();
  }

  class Connection {
   public:
    explicit Connection(const std::string& socket) : fd_(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
      sockaddr_un address{};
      address.sun_family = AF_UNIX;
      std::strcpy(address.sun_path, socket.c_str());
      EXPECT_EQ(::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    }
    ~Connection() { ::close(fd_); }
    Connection(const Connection&) = delete;
    Connection& operator=(const Connection&) = delete;
    bool send(const std::string& bytes) const {
      return ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(bytes.size());
    }
    /// Until the server closes.
    [[nodiscard]] std::string rest() const {
      std::string got;
      char buffer[65'536];
      for (ssize_t n = 0; (n = ::read(fd_, buffer, sizeof buffer)) > 0;)
        got.append(buffer, static_cast<std::size_t>(n));
      return got;
    }

   private:
    int fd_;
  };
  [[nodiscard]] std::unique_ptr<Connection> connect() const { return std::make_unique<Connection>(socket_); }
  [[nodiscard]] std::string ask(const std::string& path = "/") const {
    const Connection c(socket_);
    (void)c.send("GET " + path + " HTTP/1.1\r\nConnection: close\r\n\r\n");
    return c.rest().substr(0, 12);
  }
  static std::string post(std::size_t bytes) {
    return "POST / HTTP/1.1\r\nConnection: close\r\nContent-Length: " + std::to_string(bytes) + "\r\n\r\n";
  }

  testing::TemporaryDirectory folder_{"limits"};
  std::string socket_ = (folder_.path() / "s").string();
  UnixListener listener_{socket_, 0600};
  std::unique_ptr<HttpServer> server_;
  std::thread thread_;
};

/// A byte now and then does not keep a connection: the deadline is of the whole.
TEST_F(ApiLimitsTest, ABodyThatDripsIsGivenUpAtItsDeadline) {
  const auto slow = connect();
  ASSERT_TRUE(slow->send(post(100'000)));
  const auto began = Clock::now();
  std::thread dripping([&] {
    while (Clock::now() - began < 20 * kBody && slow->send("x")) std::this_thread::sleep_for(milliseconds(20));
  });
  EXPECT_EQ(slow->rest(), "");
  const auto took = Clock::now() - began;
  dripping.join();
  EXPECT_GE(took, kBody - milliseconds(50));
  EXPECT_LT(took, 10 * kBody);
  EXPECT_EQ(ask(), "HTTP/1.1 200");
}

TEST_F(ApiLimitsTest, AHeaderThatDripsIsGivenUpAtItsDeadline) {
  const auto slow = connect();
  const auto began = Clock::now();
  std::thread dripping([&] {
    (void)slow->send("GET / HTTP/1.1\r\n");
    while (Clock::now() - began < 20 * kHeader && slow->send("X: y\r\n")) std::this_thread::sleep_for(milliseconds(20));
  });
  EXPECT_EQ(slow->rest(), "");
  EXPECT_LT(Clock::now() - began, 10 * kHeader);
  dripping.join();
}

TEST_F(ApiLimitsTest, AnAnswerThatNobodyTakesIsGivenUp) {
  std::vector<std::unique_ptr<Connection>> slow;
  for (int i = 0; i < 4; ++i) {
    slow.push_back(connect());
    ASSERT_TRUE(slow.back()->send("GET /long HTTP/1.1\r\n\r\n"));
  }
  EXPECT_EQ(ask(), "HTTP/1.1 200") << "others do not wait for them";
  std::this_thread::sleep_for(4 * kAnswer);
  for (const auto& c : slow) EXPECT_LT(c->rest().size(), kLongAnswer);
  const auto quick = connect();
  ASSERT_TRUE(quick->send("GET /long HTTP/1.1\r\nConnection: close\r\n\r\n"));
  EXPECT_GT(quick->rest().size(), kLongAnswer);
}

TEST_F(ApiLimitsTest, ManyLongBodiesShareOneBound) {
  const auto first = connect(), second = connect();
  ASSERT_TRUE(first->send(post(190'000) + "x"));
  std::this_thread::sleep_for(milliseconds(50));
  ASSERT_TRUE(second->send(post(190'000)));
  EXPECT_THAT(second->rest(), HasSubstr("503"));
  // A short one has room; and the place of the first is free when it has gone.
  const auto small = connect();
  ASSERT_TRUE(small->send(post(5) + "12345"));
  EXPECT_THAT(small->rest(), HasSubstr("200"));
  EXPECT_EQ(first->rest(), "");
  const auto third = connect();
  ASSERT_TRUE(third->send(post(190'000) + std::string(190'000, 'x')));
  EXPECT_THAT(third->rest(), HasSubstr("200"));
}

TEST_F(ApiLimitsTest, TooLongATooBigHeaderAndTooManyAreRefusedWithTheirNumber) {
  const auto body = connect(), header = connect();
  ASSERT_TRUE(body->send(post(200'001)));
  EXPECT_THAT(body->rest(), HasSubstr("413"));
  ASSERT_TRUE(header->send("GET / HTTP/1.1\r\nX: " + std::string(2000, 'y') + "\r\n\r\n"));
  EXPECT_THAT(header->rest(), HasSubstr("431"));
  std::vector<std::unique_ptr<Connection>> idle;
  for (int i = 0; i < 9; ++i) idle.push_back(connect());
  EXPECT_THAT(idle.front()->rest(), HasSubstr("503"));
  EXPECT_EQ(ask(), "HTTP/1.1 200");
}

}  // namespace
}  // namespace isorig::daemon::test
