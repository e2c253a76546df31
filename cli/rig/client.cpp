#include "cli/rig/client.hpp"

#include <sys/socket.h>
#include <sys/time.h>

#include <algorithm>
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/beast/core/basic_stream.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <cerrno>
#include <chrono>
#include <string_view>
#include <thread>

#include "daemon/host/paths.hpp"

namespace isorig::cli {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using boost::system::error_code;
using Message = http::request<http::string_body>;

constexpr auto kBeforeNextAttempt = std::chrono::milliseconds(20);
constexpr int kAttempts = 5;
constexpr std::array<std::string_view, 3> kStopCalls{"/v1/status", "/v1/abort", "/v1/pause"};

/// A daemon that is stopped accepts nothing: when the queue of its socket is full (SOMAXCONN), connect() blocks until
/// SO_SNDTIMEO and says EAGAIN, or EINTR for a signal (unix(7), socket(7)). Asio would take that for a connection that
/// is being made.
error_code connect_within(std::chrono::milliseconds patience, const net::local::stream_protocol::endpoint& where,
                          net::local::stream_protocol::socket& socket) {
  error_code error;
  socket.open(net::local::stream_protocol(), error);
  if (error) return error;
  const timeval limit{patience.count() / 1000, patience.count() % 1000 * 1000};
  if (::setsockopt(socket.native_handle(), SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof limit) != 0 ||
      ::connect(socket.native_handle(), where.data(), static_cast<socklen_t>(where.size())) != 0) {
    return errno == EAGAIN || errno == EINTR ? error_code(beast::error::timeout)
                                             : error_code(errno, boost::system::system_category());
  }
  return {};
}

/// One request on a connection of its own. `connected` says how far it came.
error_code exchange(const std::string& socket, std::chrono::milliseconds patience, const Message& request,
                    http::response<http::string_body>& response, bool& connected) {
  net::io_context io;
  beast::basic_stream<net::local::stream_protocol> stream(io);
  error_code result;
  connected = false;
  try {
    result = connect_within(patience, net::local::stream_protocol::endpoint(socket), stream.socket());
  } catch (const boost::system::system_error& e) {
    return e.code();  // the path is too long for a socket
  }
  if (result) return result;
  connected = true;
  beast::flat_buffer buffer;
  stream.expires_after(patience);
  // What was refused unread may have been answered all the same: a failed write does not keep from reading.
  http::async_write(stream, request, [&](error_code, std::size_t) {
    http::async_read(stream, buffer, response, [&](error_code error, std::size_t) { result = error; });
  });
  io.run();
  return result;
}

[[noreturn]] void explain(const std::string& where, error_code error, bool connected) {
  if (error == beast::error::timeout) throw NoAnswer("the daemon on " + where + " did not answer: " + error.message());
  if (connected) throw NoDaemon("the daemon on " + where + " did not answer: " + error.message());
  if (error == boost::system::errc::no_such_file_or_directory || error == boost::system::errc::connection_refused) {
    throw NoDaemon("no daemon answers on " + where +
                   "; start one: isorigd --rig RIG.toml (or name its socket: --socket)");
  }
  if (error == boost::system::errc::permission_denied || error == boost::system::errc::operation_not_permitted) {
    throw NoDaemon("you may not open " + where + "; ask to be added to its group");
  }
  throw NoDaemon("cannot open " + where + ": " + error.message());
}

}  // namespace

Answer Client::ask(const std::string& method, const std::string& path, std::string body) const {
  Message request(http::string_to_verb(method), path, 11);
  request.set(http::field::host, "localhost");
  request.set(http::field::content_type, "application/json");
  request.keep_alive(false);
  request.body() = std::move(body);
  request.prepare_payload();

  auto socket = socket_;
  const auto stops = daemon::stop_socket_of(socket_);
  std::error_code ignored;
  if (std::find(kStopCalls.begin(), kStopCalls.end(), path) != kStopCalls.end() &&
      std::filesystem::exists(stops, ignored)) {
    socket = stops;
  }
  error_code error;
  bool connected = false;
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    http::response<http::string_body> response;
    error = exchange(socket.string(), patience_, request, response, connected);
    if (!error && response.result() != http::status::service_unavailable) {
      Answer answer{static_cast<int>(response.result_int()), nlohmann::json::parse(response.body(), nullptr, false)};
      if (answer.body.is_discarded()) answer.body = {{"text", "the daemon's answer is not JSON: " + response.body()}};
      return answer;
    }
    if (!error) error = boost::system::errc::make_error_code(boost::system::errc::resource_unavailable_try_again);
    // Given up in a crowd before the request was read, or the door was shut: it did not happen, and may be tried again.
    const bool crowded = error == boost::system::errc::resource_unavailable_try_again ||
                         error == boost::system::errc::connection_reset || error == http::error::end_of_stream;
    if (!crowded) break;
    std::this_thread::sleep_for(kBeforeNextAttempt);
  }
  explain(socket_.string(), error, connected);
}

nlohmann::json Client::get_or_throw(const std::string& path) const {
  auto answer = get(path);
  if (!answer.ok()) throw std::runtime_error(answer.text());
  return std::move(answer.body);
}

Answer Client::get(const std::string& path) const {
  return ask("GET", path, {});
}

Answer Client::post(const std::string& path, const nlohmann::json& body) const {
  return ask("POST", path, body.dump());
}

}  // namespace isorig::cli
