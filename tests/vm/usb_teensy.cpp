// Plugs an emulated Teensy into vhci-hcd and keeps it there until it is ended: usb_teensy [--serial NUMBER]
#include <csignal>
#include <cstdio>
#include <cstring>

#include "usb_bench.hpp"

int main(int argc, char** argv) try {
  const char* serial = argc == 3 && std::strcmp(argv[1], "--serial") == 0 ? argv[2] : "1234560";
  sigset_t stop;
  sigemptyset(&stop);
  sigaddset(&stop, SIGTERM);
  sigaddset(&stop, SIGINT);
  pthread_sigmask(SIG_BLOCK, &stop, nullptr);
  const isorig::pressure::LiveTeensy teensy(serial);
  int signal = 0;
  sigwait(&stop, &signal);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "usb_teensy: %s\n", error.what());
  return 1;
}
