// What a Modbus gateway answers, through the link and the frame's driver over the shipped register maps.
#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "drivers/api/error.hpp"
#include "drivers/clock/real_clock.hpp"
#include "drivers/frame/modbus_frame.hpp"
#include "drivers/modbus/modbus_adu.hpp"
#include "tree.hpp"
#include "wire.hpp"

namespace isorig::fuzz {
namespace {

using modbus::Quantity;

/// All of a gateway, zeros at first. Those that were written are kept in mind, so that no input clears 128 KiB.
class Registers {
 public:
  void put(std::size_t address, std::uint16_t word) {
    words_[address % words_.size()] = word;
    written_.push_back(address % words_.size());
  }
  [[nodiscard]] std::uint16_t at(std::size_t address) const { return words_[address % words_.size()]; }
  void clear() {
    for (const auto address : written_) words_[address] = 0;
    written_.clear();
  }

 private:
  std::vector<std::uint16_t> words_ = std::vector<std::uint16_t>(65536);
  std::vector<std::size_t> written_;
};

/// Registers as a gateway holds them, and answers as the input wants them.
class Gateway final : public Peer {
 public:
  Gateway(Input& in, const modbus::ModbusConfig& config) : in_(in), config_(config) {
    registers_.clear();
    set(Quantity::kIdentityWord, config.map.expected_identity_word);
    set(Quantity::kSampleRate_Hz, 1000.0);
  }

  std::string answer(std::string_view written) override {
    unfinished_ += written;
    std::string out;
    while (const auto size = request_size()) {
      const std::string request = unfinished_.substr(0, size);
      unfinished_.erase(0, size);
      out += answer_to({reinterpret_cast<const std::uint8_t*>(request.data()), request.size()});
    }
    return out;
  }
  bool closes() override { return std::exchange(closes_, false); }
  void waited(std::int64_t) override {}

 private:
  [[nodiscard]] bool rtu() const { return config_.transport == modbus::ModbusTransport::kRtu; }

  void set(Quantity quantity, double value) {
    const auto& at = config_.map.at(quantity);
    if (!at) return;
    const auto words = at->format.encode(value);
    for (std::size_t i = 0; words && i < at->format.registers(); ++i) registers_.put(at->address + i, (*words)[i]);
  }

  /// Of the request that stands in front, once it is whole.
  [[nodiscard]] std::size_t request_size() const {
    const Bytes all{reinterpret_cast<const std::uint8_t*>(unfinished_.data()), unfinished_.size()};
    if (!rtu()) {
      if (all.size() < modbus::kHeader) return 0;
      const std::size_t size = 6U + modbus::word_at(all, 4);
      return all.size() < size ? 0 : size;
    }
    if (all.size() < 8) return 0;
    const std::size_t size = all[1] == 16 ? 9U + all[6] : 8U;
    return all.size() < size ? 0 : size;
  }

  std::string framed(Bytes pdu, std::uint16_t transaction, std::uint8_t unit) const {
    const auto bytes = rtu() ? modbus::rtu_frame(unit, pdu) : modbus::tcp_frame(transaction, unit, pdu);
    return {bytes.begin(), bytes.end()};
  }

  /// The right answer, with registers that the input has changed.
  std::vector<std::uint8_t> right(Bytes pdu, unsigned changes) {
    const auto address = modbus::word_at(pdu, 1), word = modbus::word_at(pdu, 3);
    if (pdu[0] == 6) registers_.put(address, word);
    if (pdu[0] == 16) {
      for (std::size_t i = 0; i < word && 7 + 2 * i < pdu.size(); ++i)
        registers_.put(address + i, modbus::word_at(pdu, 6 + 2 * i));
    }
    if (pdu[0] == 6 || pdu[0] == 16) return {pdu.begin(), pdu.begin() + 5};
    for (unsigned i = 0; i < changes; ++i) {
      const auto at = in_.byte();
      registers_.put(address + at % std::max<unsigned>(word, 1), in_.word());
    }
    std::vector<std::uint8_t> out{pdu[0], static_cast<std::uint8_t>(2 * word)};
    for (std::size_t i = 0; i < word; ++i) {
      const auto value = registers_.at(address + i);
      out.push_back(static_cast<std::uint8_t>(value >> 8U));
      out.push_back(static_cast<std::uint8_t>(value));
    }
    return out;
  }

  std::string answer_to(Bytes request) {
    const auto transaction = rtu() ? std::uint16_t{0} : modbus::word_at(request, 0);
    const auto unit = rtu() ? request[0] : request[6];
    const auto pdu = rtu() ? request.subspan(1, request.size() - 3) : request.subspan(modbus::kHeader);
    const auto how = in_.byte();
    const auto answer = framed(right(pdu, how % 16 < 8 ? how / 16U : 0), transaction, unit);
    switch (how % 16) {
      case 8: {
        const std::array<std::uint8_t, 2> exception{static_cast<std::uint8_t>(pdu[0] | modbus::kExceptionBit),
                                                    in_.byte()};
        return framed(exception, transaction, unit);
      }
      case 9:
        return std::string(text(in_.take(in_.byte())));
      case 10:
        return framed(in_.take(in_.byte()), transaction, unit);
      case 11:
        return answer.substr(0, in_.byte());
      case 12:
        return answer + answer;
      case 13:
        return framed(right(pdu, 0), static_cast<std::uint16_t>(transaction - 1), unit) + answer;
      case 14:
        return {};
      case 15:
        closes_ = true;
        return answer.substr(0, in_.byte());
      default:
        return answer;
    }
  }

  Input& in_;
  const modbus::ModbusConfig& config_;
  static inline Registers registers_;
  std::string unfinished_;
  bool closes_ = false;
};

modbus::ModbusConfig config_of(std::uint8_t choice) {
  static const std::array maps{modbus::read_register_map(test::source_path("/config/frames/isorig-gateway.toml")),
                               modbus::read_register_map(test::source_path("/config/frames/int32-scaled.toml"))};
  modbus::ModbusConfig config;
  config.map = maps[choice / 2 % 2];
  config.transport = choice % 2 == 1 ? modbus::ModbusTransport::kRtu : modbus::ModbusTransport::kTcp;
  config.frame_gap_us = 1;
  config.response_timeout_ms = 20;
  config.start_confirm_ms = 20;
  return config;
}

void run(Input in) {
  const auto config = config_of(in.byte());
  Gateway gateway(in, config);
  const OnTheWire wire(gateway);
  clock::RealClock clock;
  frame::ModbusFrame device(config, clock);
  std::array<frame::Sample, 256> samples{};
  use(in, device, samples, {.acts = 12, .kinds = 8});
}

}  // namespace
}  // namespace isorig::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isorig::fuzz::run({data, size});
  return 0;
}
