#pragma once
#include <cstdlib>
#include <filesystem>
#include <string>

namespace isorig::daemon {

/// Where daemon and tools meet unless told otherwise: $ISORIG_SOCKET, else the service's socket when it is there,
/// else the user's runtime directory.
inline std::filesystem::path default_socket() {
  if (const char* named = std::getenv("ISORIG_SOCKET"); named != nullptr && *named != '\0') return named;
  std::filesystem::path service = "/run/isorig/isorigd.sock";
  std::error_code ignored;
  if (std::filesystem::exists(service, ignored)) return service;
  if (const char* runtime = std::getenv("XDG_RUNTIME_DIR"); runtime != nullptr && *runtime != '\0') {
    return std::filesystem::path(runtime) / "isorigd.sock";
  }
  return std::filesystem::temp_directory_path() /
         ("isorigd-" + std::string(std::getenv("USER") ? std::getenv("USER") : "user") + ".sock");
}

/// Where the daemon on `socket` takes abort, pause and status whatever else it is asked for (docs/api.md).
inline std::filesystem::path stop_socket_of(const std::filesystem::path& socket) {
  return socket.string() + ".stop";
}

/// Where the daemon on `socket` streams every sample (docs/sample-stream.md).
inline std::filesystem::path sample_socket_of(const std::filesystem::path& socket) {
  return socket.string() + ".samples";
}

/// Where the live page's server of the daemon on `socket` gives links (docs/web.md): the service has a folder of its
/// own.
inline std::filesystem::path web_socket_of(const std::filesystem::path& socket) {
  if (socket == "/run/isorig/isorigd.sock") return "/run/isorig-web/web.sock";
  return socket.string() + ".web";
}

/// Where runs are kept unless told otherwise: $ISORIG_RUNS, else ./runs.
inline std::filesystem::path default_runs() {
  if (const char* named = std::getenv("ISORIG_RUNS"); named != nullptr && *named != '\0') return named;
  return "runs";
}

/// Where diagnoses are looked for unless told otherwise: beside the runs, since what a daemon keeps there is its own.
inline std::filesystem::path diagnoses_beside(const std::filesystem::path& runs_root) {
  auto runs = std::filesystem::absolute(runs_root).lexically_normal();
  if (!runs.has_filename()) runs = runs.parent_path();
  return runs.parent_path() / "diagnoses";
}

/// Where commands that only read look for runs: as above, but where there is no ./runs, in the service's if this user
/// may look into it.
inline std::filesystem::path default_catalogue() {
  auto own = default_runs();
  std::error_code ignored;
  if (std::getenv("ISORIG_RUNS") != nullptr || std::filesystem::is_directory(own, ignored)) return own;
  const std::filesystem::path service = "/var/lib/isorig/runs";
  return std::filesystem::is_directory(service, ignored) ? service : own;
}

}  // namespace isorig::daemon
