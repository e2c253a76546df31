// What a Modbus gateway answers, through the link, the frame's driver over the shipped register maps, and the pressure
// regulator's driver over its own.
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "drivers/api/error.hpp"
#include "drivers/clock/real_clock.hpp"
#include "drivers/frame/modbus_frame.hpp"
#include "drivers/modbus/modbus_adu.hpp"
#include "drivers/pressure/alicat_regulator.hpp"
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
  Gateway(Input& in, modbus::ModbusTransport transport) : in_(in), transport_(transport) { registers_.clear(); }

  void put(std::size_t address, std::span<const std::uint16_t> words) {
    for (std::size_t i = 0; i < words.size(); ++i) registers_.put(address + i, words[i]);
  }
  [[nodiscard]] std::uint16_t at(std::size_t address) const { return registers_.at(address); }
  std::function<void(std::size_t address)> on_write;  ///< before it is answered

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
  [[nodiscard]] bool rtu() const { return transport_ == modbus::ModbusTransport::kRtu; }

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
    if (pdu[0] == 6 || pdu[0] == 16) {
      if (on_write) on_write(address);
      return {pdu.begin(), pdu.begin() + 5};
    }
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
  const modbus::ModbusTransport transport_;
  static inline Registers registers_;
  std::string unfinished_;
  bool closes_ = false;
};

modbus::ModbusConfig line_of(std::uint8_t choice) {
  modbus::ModbusConfig config;
  config.transport = choice % 2 == 1 ? modbus::ModbusTransport::kRtu : modbus::ModbusTransport::kTcp;
  config.frame_gap_us = 1;
  config.response_timeout_ms = 20;
  config.start_confirm_ms = 20;
  return config;
}

void run_frame(Input& in, std::uint8_t choice) {
  static const std::array maps{modbus::read_register_map(test::source_path("/config/frames/isorig-gateway.toml")),
                               modbus::read_register_map(test::source_path("/config/frames/int32-scaled.toml"))};
  auto config = line_of(choice);
  config.map = maps[choice / 2 % 2];
  Gateway gateway(in, config.transport);
  const auto set = [&](Quantity quantity, double value) {
    const auto& at = config.map.at(quantity);
    if (!at) return;
    if (const auto words = at->format.encode(value))
      gateway.put(at->address, std::span(*words).first(at->format.registers()));
  };
  set(Quantity::kIdentityWord, config.map.expected_identity_word);
  set(Quantity::kSampleRate_Hz, 1000.0);
  const OnTheWire wire(gateway);
  clock::RealClock clock;
  frame::ModbusFrame device(config, clock);
  std::array<frame::Sample, 256> samples{};
  use(in, device, samples, {.acts = 12, .kinds = 8});
}

/// What the daemon does with it: set-points, exhausts, and readings of which the rig's pressure is judged.
void run_regulator(Input& in, std::uint8_t choice) {
  static const auto map = pressure::read_regulator_map(test::source_path("/config/regulators/alicat.toml"));
  pressure::RegulatorConfig config;
  config.map = map;
  config.line = line_of(choice);
  config.max_psi = 24.0;
  Gateway gateway(in, config.line.transport);
  const auto float_at = [&](std::uint16_t address) {
    const std::array words{gateway.at(address), gateway.at(address + 1U)};
    return modbus::number_of(modbus::join_words(words, modbus::RegisterType::kFloat32, map.order),
                             modbus::RegisterType::kFloat32);
  };
  const auto known = modbus::bits_of(0.5 * (map.known_min + map.known_max), modbus::RegisterType::kFloat32);
  gateway.put(map.known, modbus::split_words(known.value(), modbus::RegisterType::kFloat32, map.order));
  double asked_psi = 0.0;
  gateway.on_write = [&](std::size_t address) {
    if (address != map.setpoint) return;
    const double psi = float_at(map.setpoint) * map.psi_per_unit;
    require(psi >= 0.0 && psi <= config.max_psi, "a set-point beyond max_psi on the wire");
    require(psi == 0.0 || std::abs(psi - asked_psi) < 1e-3, "a set-point that nobody asked for");
  };
  const OnTheWire wire(gateway);
  pressure::AlicatRegulator device(config);
  const auto act = [&](int) {
    const auto what = in.byte() % 8;
    if (what == 1) {
      asked_psi = static_cast<double>(in.byte()) / 8.0;  // up to 31.9: some above max_psi
      device.regulate(static_cast<float>(asked_psi));
    } else if (what == 2) {
      device.exhaust();
    } else {
      const auto state = device.read();
      require(std::isfinite(state.pressure_psi) && std::isfinite(state.setpoint_psi), "a reading that is no number");
    }
  };
  use(in, {[&] { (void)device.connect(); }, [&] { device.disconnect(); }, act}, 12);
}

void run(Input in) {
  const auto choice = in.byte();
  if (choice / 4 % 2 == 0) return run_frame(in, choice);
  run_regulator(in, choice);
}

}  // namespace
}  // namespace isorig::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isorig::fuzz::run({data, size});
  return 0;
}
