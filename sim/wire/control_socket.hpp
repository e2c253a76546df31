#pragma once
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace isorig::sim {

/// A Unix socket that takes lines and answers each. For its owner alone (mode 0600). One thread calls
/// service(); nothing in it blocks.
class ControlSocket {
 public:
  using Answer = std::function<std::string(std::string_view line)>;

  /// Replaces what stands at `path`. Throws std::system_error.
  ControlSocket(std::string path, Answer answer);
  ~ControlSocket();
  ControlSocket(const ControlSocket&) = delete;
  ControlSocket& operator=(const ControlSocket&) = delete;

  void service();

  /// The client's half: sends one line, returns the whole answer. Throws std::system_error.
  static std::string ask(const std::string& path, const std::string& line);

 private:
  struct Client {
    int fd = -1;
    std::string received;
  };
  bool serve(Client& client);

  std::string path_;
  Answer answer_;
  int fd_ = -1;
  std::vector<Client> clients_;
};

}  // namespace isorig::sim
