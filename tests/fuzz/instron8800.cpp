// What an 8800-type controller answers, through the driver: connection, rounds of samples, segments and stops.
#include <array>
#include <map>
#include <string>
#include <utility>

#include "drivers/api/error.hpp"
#include "drivers/frame/instron8800_frame.hpp"
#include "wire.hpp"

namespace isorig::fuzz {
namespace {

/// Answers as a healthy controller does, unless the input says otherwise of a question.
class Controller final : public Peer {
 public:
  Controller(Input& in, clock::VirtualClock& clock) : in_(in), clock_(clock) {}

  std::string answer(std::string_view written) override {
    std::string out;
    clock_.sleep_until_ns(clock_.now_ns() + 1'000'000);
    unfinished_ += written;
    for (auto end = unfinished_.find("\r\n"); end != std::string::npos; end = unfinished_.find("\r\n")) {
      const auto line = unfinished_.substr(0, end);
      unfinished_.erase(0, end + 2);
      out += answer_to(line);
    }
    if (written.empty() && !in_.empty() && in_.byte() % 8 == 1) out += line_of_input();  // that nobody asked for
    return out;
  }
  bool closes() override { return std::exchange(closes_, false); }
  void waited(std::int64_t timeout_ns) override {
    clock_.sleep_until_ns(clock_.now_ns() + std::max<std::int64_t>(timeout_ns, 0) + 1);
  }

 private:
  std::string line_of_input() {
    const auto bytes = in_.take(in_.byte());
    return std::string(text(bytes));
  }

  std::string answer_to(const std::string& line) {
    if (line.starts_with("C") || line.starts_with("P")) {
      const auto comma = line.find(',');
      if (comma == std::string::npos) return {};
      // "C1,1" is asked for as "Q1", "C2,1,3" as "Q2,1": the last number is the value.
      const auto last = line.rfind(',');
      if (line.starts_with("C904")) {
        says_["Q904"] = line.substr(comma + 1);
      } else {
        says_["Q" + line.substr(1, last - 1)] = line.substr(last + 1);
      }
      return in_.byte() % 32 == 1 ? line_of_input() : std::string{};
    }
    switch (const auto how = in_.byte(); how % 16) {
      case 1:
        return line_of_input();
      case 2:
        return {};  // keeps silent
      case 3:
        return line_of_input() + "\r\n";
      case 4:
        return healthy(line) + "\r\n" + healthy(line) + "\r\n";
      case 5:
        closes_ = true;
        return healthy(line);
      case 6:
        clock_.sleep_until_ns(clock_.now_ns() + std::int64_t{in_.byte()} * 10'000'000);
        return healthy(line) + "\r\n";
      default:
        return healthy(line) + "\r\n";
    }
  }

  std::string healthy(const std::string& line) {
    if (const auto said = says_.find(line); said != says_.end()) return said->second;
    if (line == "Q307,1") return "0,3";
    if (line == "Q307,2") return "0,2";
    if (line == "Q308,1") return "0.05";
    if (line == "Q308,2") return "250";
    if (line == "Q300") return "1";
    if (line == "Q904") return "0,0";
    if (line == "Q23") return "1";
    if (line.starts_with("Q134,1")) return "0.0001";
    return "0";
  }

  Input& in_;
  clock::VirtualClock& clock_;
  std::map<std::string, std::string> says_;
  std::string unfinished_;
  bool closes_ = false;
};

void run(Input in) {
  clock::VirtualClock clock{5'000'000'000};
  frame::Instron8800Config config;
  config.response_timeout_ms = 50;
  config.give_up_ms = 500;
  config.gap_us = 200;
  config.quiet_ms = 5;
  config.start_confirm_ms = config.stop_confirm_ms = 100;
  config.heartbeat_timeout_ms = 1000;
  config.tcp = in.byte() % 4 != 1;
  Controller controller(in, clock);
  const OnTheWire wire(controller);
  frame::Instron8800Frame device(config, clock);
  std::array<frame::Sample, 16> samples{};
  use(in, device, samples, {.acts = 48, .kinds = 16});
}

}  // namespace
}  // namespace isorig::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isorig::fuzz::run({data, size});
  return 0;
}
