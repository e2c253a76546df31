#include "cli/client.hpp"

#include <httplib.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace isorig::cli {
namespace {

/// cpp-httplib 0.11 knows no Unix sockets: its client is handed one that is connected.
class UnixClient : public httplib::ClientImpl {
 public:
  explicit UnixClient(std::string path) : ClientImpl("localhost"), path_(std::move(path)) {}
  [[nodiscard]] int connect_error() const { return connect_error_; }

 private:
  bool create_and_connect_socket(Socket& socket, httplib::Error& error) override {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    if (path_.size() >= sizeof address.sun_path) {
      connect_error_ = ENAMETOOLONG;
    } else {
      std::memcpy(address.sun_path, path_.c_str(), path_.size() + 1);
      const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
      if (fd >= 0 && ::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) {
        socket.sock = fd;
        return true;
      }
      connect_error_ = errno;
      if (fd >= 0) ::close(fd);
    }
    error = httplib::Error::Connection;
    return false;
  }

  std::string path_;
  int connect_error_ = 0;
};

Answer finish(const std::filesystem::path& socket, const UnixClient& client, const httplib::Result& result) {
  if (!result) {
    const std::string where = socket.string();
    switch (client.connect_error()) {
      case ENOENT:
      case ECONNREFUSED:
        throw NoDaemon("no daemon answers on " + where + "; start one: isorigd --rig RIG.toml (or name its socket: --socket)");
      case EACCES:
      case EPERM:
        throw NoDaemon("you may not open " + where + "; ask to be added to its group");
      case 0: throw NoDaemon("the daemon on " + where + " did not answer: " + httplib::to_string(result.error()));
      default: throw NoDaemon("cannot open " + where + ": " + std::strerror(client.connect_error()));
    }
  }
  Answer answer{result->status, nlohmann::json::parse(result->body, nullptr, false)};
  if (answer.body.is_discarded()) answer.body = {{"text", "the daemon's answer is not JSON: " + result->body}};
  return answer;
}

}  // namespace

Answer Client::get(const std::string& path) const {
  UnixClient client(socket_.string());
  return finish(socket_, client, client.Get(path));
}

Answer Client::post(const std::string& path, const nlohmann::json& body) const {
  UnixClient client(socket_.string());
  client.set_read_timeout(30);
  return finish(socket_, client, client.Post(path, body.dump(), "application/json"));
}

}  // namespace isorig::cli
