// Writes the seeds of every target to OUT/TARGET/: the files of the repository, what the programs themselves write
// (a run in virtual time, frames of the wire protocols), and requests.
//
//   fuzz_seeds OUT
#include <algorithm>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "daemon/host/virtual_run.hpp"
#include "daemon/recording/sample_stream.hpp"
#include "messages/log_reader.hpp"
#include "messages/log_writer.hpp"
#include "messages/segment_files.hpp"
#include "messages/teensy/wire.hpp"
#include "model/catalogue.hpp"
#include "model/composed.hpp"
#include "target.hpp"
#include "tree.hpp"

namespace {

using namespace isorig;
namespace fs = std::filesystem;
using nlohmann::json;

fs::path out;

void seed(const std::string& target, const std::string& name, const std::string& bytes) {
  fs::create_directories(out / target);
  fuzz::put(out / target / name, bytes);
}

std::string slurp(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  fuzz::require(!text.str().empty(), path.string() + " is not there, or empty");
  return text.str();
}

/// Every file under the folders of the repository that ends so.
std::map<std::string, std::string> files(std::initializer_list<const char*> folders, const std::string& ending) {
  std::map<std::string, std::string> found;
  for (const char* folder : folders) {
    const auto root = fs::path(test::source_path()) / folder;
    for (const auto& entry : fs::recursive_directory_iterator(root)) {
      if (!entry.is_regular_file() || entry.path().extension() != ending) continue;
      auto name = entry.path().lexically_relative(test::source_path()).string();
      for (char& c : name)
        if (c == '/') c = '_';
      found[name] = slurp(entry.path());
    }
  }
  fuzz::require(!found.empty(), "no seed among the files of the repository");
  return found;
}

void repository() {
  for (const auto& [name, text] : files({"config/rigs", "tests/formats/samples/first/rigs"}, ".toml"))
    seed("rig_toml", name, text);
  for (const auto& [name, text] : files({"config/protocols", "tests/formats/samples/first/protocols"}, ".toml"))
    seed("protocol_toml", name, text);
  for (const auto& [name, text] :
       files({"config/specimens", "config/frames", "config/regulators", "tests/formats/samples"}, ".toml"))
    seed("tables_toml", name, text);
  seed("tables_toml", "mapping.toml",
       "format = \"isorig-mapping/1\"\ndelimiter = \";\"\ndecimal = \",\"\nspecimen = \"Control2\"\n"
       "rest_length_mm = 94.3\nzero_mm = 1.5\n[column]\ntime = \"Zeit\"\nforce = \"#3\"\n[unit]\nZeit = \"ms\"\n");
  const fs::path samples = test::source_path("/tests/formats/samples");
  const std::string mark(fuzz::kPartMark);
  const auto folder = samples / "2026-11-23/rep-1_5-psi";
  seed("recording", "whole",
       slurp(folder / "recording.toml") + mark + slurp(folder / "frame.csv") + mark + slurp(folder / "pressure.csv"));
  seed("recording", "first",
       slurp(samples / "first/recording/recording.toml") + mark + slurp(samples / "first/recording/frame.csv"));
}

void models() {
  const fs::path samples = test::source_path("/tests/formats/samples/2026-11-23");
  seed("model_toml", "model", slurp(samples / "model.toml"));
  seed("model_toml", "nominal", slurp(samples / "nominal.toml"));
  for (const auto* effect : model::effects()) {
    auto spec = model::nominal_model("slse1");
    for (const auto& law : effect->laws) spec.parts.push_back(model::make_part(*effect, law));
    seed("model_toml", std::string(effect->name), model::model_text(spec));
  }
}

std::string utf16(const std::string& ascii) {
  std::string wide = "\xFF\xFE";
  for (const char c : ascii) (wide += c) += '\0';
  return wide;
}

void other_programs() {
  const std::string english =
      "Test : Rate 1,\"600.00000\",mm/min\r\n\r\nTime,Extension,Load\r\n(s),(mm),(N)\r\n\"0.00000\",\"66.50750\","
      "\"100.28658\"\r\n\"0.10000\",\"67.37132\",\"-23.44689\"\r\n\"0.18500\",\"68.25761\",\"1,021.21619\"\r\n";
  seed("foreign", "english", english);
  seed("foreign", "utf-16", utf16(english));
  seed("foreign", "german",
       "\"Pr\xFC"
       "fverfahren\";\"Zug.im_tens\"\r\n;\"(N)\";\"(mm)\"\r\n\"1\";\"8,1\";\"1,9\"\r\n\r\n\"Zeit\";\"Verl\xE4"
       "ngerung\";\"Standardkraft\"\r\n\"(s)\";\"(mm)\";\"(kN)\"\r\n\"0,00000\";\"0,50000\";\"0,00125\"\r\n\"0,02000\";"
       "\"1.000,25000\";\"0,00250\"\r\n");
  seed("foreign", "log", "12034,5.03\n12044,5.04\n12054,5.05\n");
  seed("foreign", "clock", "Time,Extension (mm),Load (N)\n23:59:59.5,1,2\n0:00:00.1,2,3\n29.11.2026 12:00:01 AM,3,4\n");
  seed("foreign", "micros", "4294967200 1638\n4294967290 1700\n84 1750\n");
  seed("foreign", "tabs", "Time (ms)\tPosition (in)\tForce [lbf]\tPressure (kPa)\n0\t1\t1\t1\n1\t2\t2\t2\n");
  seed("foreign", "recording", slurp(test::source_path("/tests/formats/samples/2026-11-23/rep-1_5-psi/frame.csv")));
}

template <class... Messages>
std::string frames(char mode, const Messages&... messages) {
  std::string bytes(1, mode);
  const auto add = [&](const messages::teensy::Frame& frame, bool seal) {
    if (seal) {
      // Without its COBS and CRC, which the target makes.
      std::uint8_t packet[messages::teensy::kMaxPayload];
      const auto size = messages::teensy::cobs_decode(frame.bytes, frame.size - 1, packet) - messages::teensy::kCrcSize;
      bytes += '\1';
      bytes += static_cast<char>(size);
      bytes.append(reinterpret_cast<const char*>(packet), size);
    } else {
      bytes += '\0';
      bytes += static_cast<char>(frame.size);
      bytes.append(reinterpret_cast<const char*>(frame.bytes), frame.size);
    }
    if (mode == 3) bytes += '\3', bytes += '\1', bytes += '\0', bytes += '\1', bytes += '\0';
  };
  for (const bool seal : {false, true}) (add(encode(messages), seal), ...);
  return bytes;
}

void wires() {
  namespace wire = messages::teensy;
  wire::Identity identity;
  identity.session = 1;
  identity.sample_rate_mhz = 1'000'000;
  identity.watchdog_ms = 200;
  std::strcpy(identity.model, "isorig-teensy36");
  std::strcpy(identity.serial, "1234560");
  wire::Samples samples;
  samples.count = 3;
  for (std::uint8_t i = 0; i < samples.count; ++i) samples.items[i] = {100U + i, 10'000'000U + 1000U * i, 0x19990000U};
  wire::Status status;
  status.device_us = 10'001'000;
  status.self_vents = 1;
  status.flags = wire::kStatusSelfVented | wire::kStatusHasLimits;
  const wire::SyncEdge edge{10'002'000, 1, 1};
  const wire::TimeSyncReply reply{1, 10'003'000, 10'003'010};
  const wire::LimitsReply limits{{9000, 100, 20'000}, 1};
  for (const char mode : {'\0', '\1', '\2'})
    seed("teensy", "device-" + std::to_string(mode), frames(mode, samples, status, edge, reply, limits, identity));
  wire::ValveCommand command;
  command.sequence = 1;
  command.fill_permille = 500;
  seed("teensy", "host",
       frames('\3', wire::IdentityRequest{7}, wire::Heartbeat{1}, limits.limits, command, wire::TimeSyncRequest{1}));

  // Zeros are right answers and polls; docs/fuzzing.md says what the other bytes are.
  for (int choice = 0; choice < 6; ++choice) {  // from 4 on: the regulator
    std::string bytes(1, static_cast<char>(choice));
    seed("modbus", "right-" + std::to_string(choice), bytes + std::string(200, '\0'));
    for (int i = 0; i < 40; ++i) bytes += std::string("\0\x10\0\0\1\x20\1\0\2\2\0\1\1\x40\0", 15);
    seed("modbus", "changed-" + std::to_string(choice), bytes);
    std::string bad(1, static_cast<char>(choice));
    bad += std::string(24, '\0');
    for (char how = 8; how < 16; ++how) bad += how, bad += "\2\3\4", bad += std::string(16, '\0');
    seed("modbus", "bad-" + std::to_string(choice), bad);
  }
  // Connected by eight right answers; then set-points, readings and exhausts.
  for (int choice = 4; choice < 6; ++choice) {
    std::string regulates(1, static_cast<char>(choice));
    regulates += std::string(8, '\0');
    for (const char psi : {'\x08', '\x50', '\x7f', '\xf0'})
      regulates += std::string("\1") + psi + std::string(12, '\0') + '\2' + std::string(8, '\0');
    seed("modbus", "regulates-" + std::to_string(choice), regulates);
  }
  seed("instron8800", "right", std::string(300, '\0'));
  std::string moves(40, '\0');
  for (int i = 0; i < 20; ++i) moves += std::string("\1\x40\0\0\0\0\2\0\0\3", 10);
  seed("instron8800", "moves", moves);
  for (const std::string line : {"0,3\r\n", "1e-3\r\n", "+0.5, 2\r\n", "None of these\r\n", "nan\r\n", "\r\n", "1"}) {
    for (const int before : {1, 8, 20, 60}) {
      seed("instron8800", "line-" + std::to_string(line.size()) + "-" + std::to_string(before),
           std::string(static_cast<std::size_t>(before), '\0') + '\1' + static_cast<char>(line.size()) + line +
               std::string(100, '\0'));
    }
  }
}

constexpr const char* kShort = R"(format = "isorig-protocol/1"
name = "short"
recording.policy = "round_ramps"
recording.before_s = 0.02
recording.after_s = 0.02
recording.average_interval_s = 0.1
steps = [
  { do = "repeat", unit = "session", for = { repetition = [1, 2] }, steps = [
    { do = "pressurize", pressure_psi = 1, rate_psi_s = 5, settled_for_s = 0.1, timeout_s = 20 },
    { do = "mark", label = "here" },
    { do = "ramp", to_mm = 0.2, velocity_mm_s = 10 },
    { do = "ramp", to_mm = 0, velocity_mm_s = 10 },
  ] },
]
)";

/// A log with the first event of each channel, and the last of the chain: every kind of message in a few kilobytes.
std::string one_of_each(const std::vector<fs::path>& segments, const fs::path& scratch) {
  const auto file = scratch / "one-of-each.lcm";
  fs::remove(file);
  {
    messages::LogWriter writer(file, {});
    std::set<std::string> seen;
    for (const auto& segment : segments) {
      messages::LogReader reader(segment);
      while (const auto event = reader.next()) {
        const std::string channel(event->channel);
        if (!seen.insert(channel).second && channel != "ISORIG_CHAIN" && channel != "ISORIG_SESSION") continue;
        fuzz::require(writer.append(channel, event->utime_us, event->data), "the log takes no more");
      }
    }
  }
  return slurp(file);
}

void run_logs() {
  const auto folder = fuzz::scratch() / "seed-run";
  daemon::VirtualRunOptions options;
  options.start.protocol_text = kShort;
  options.start.protocol_name = "short.toml";
  options.runs_root = folder;
  options.seed = 1;
  auto rig = daemon::load_rig(test::source_path("/config/rigs/sim.toml"));
  rig.recording.min_free_bytes = rig.recording.reserve_bytes = std::uint64_t{1} << 20U;
  const auto result = daemon::run_virtual(rig, options);
  fuzz::require(result.outcome == "done", "the run for the seeds was not done: " + result.fault);
  const auto segments = messages::list_segments(result.directory);
  const auto each = one_of_each(segments, fuzz::scratch());
  const std::string mark(fuzz::kPartMark);
  for (const char how : {'\0', '\1', '\2', '\3', '\5', '\7', '\x0b'})
    seed("run_log", "each-" + std::to_string(how), how + each);
  std::string all;
  for (const auto& segment : segments) all += (all.empty() ? "" : mark) + slurp(segment).substr(0, 30'000);
  seed("run_log", "cut", '\3' + all);
  seed("run_log", "chained", '\0' + each + mark + each);
}

void samples() {
  using namespace daemon;
  std::string stream(1, '\x20');
  samples::append(stream, samples::Hello{samples::kVersion, 1'700'000'000'000'000, "sim"});
  samples::append(stream, FrameRecord{});
  samples::append(stream, PressureRecord{});
  samples::append(stream, ControlRecord{});
  samples::append(stream, EventRecord{});
  samples::append(stream, samples::Lost{1, 2, 3, 4, 5});
  seed("sample_stream", "each", stream);
  stream[0] = '\xff';
  seed("sample_stream", "long-pieces", stream);
}

void calls() {
  const auto protocol = slurp(test::source_path("/config/protocols/vma-smoke.toml"));
  const auto specimen = slurp(test::source_path("/config/specimens/control2.toml"));
  const auto record = slurp(test::source_path("/tests/formats/samples/2026-11-23/20261121-071500-pressure.toml"));
  const std::map<std::string, std::string> bodies{
      {"start", json{{"protocol", protocol}, {"operator", "A. Lovelace"}, {"dry_run", true}}.dump()},
      {"start-specimen", json{{"protocol", "x"}, {"specimen", specimen}, {"specimen_name", "s.toml"}}.dump()},
      {"start-resume", json{{"resume_run", "latest"}, {"resume_aborted", true}, {"on_another_rig", false}}.dump()},
      {"check", json{{"protocol", protocol}, {"protocol_name", "p.toml"}}.dump()},
      {"parted", json{{"run", "20261123-r"}, {"text", "off by 3 N"}, {"then", "pause"}}.dump()},
      {"notes", json{{"run", "latest"}, {"by", "B"}, {"specimen", specimen}, {"text", "wrong label"}}.dump()},
      {"calibrations", json{{"record", record}}.dump()},
      {"setup", json{{"off", true}}.dump()},
      {"jog", json{{"to_mm", 1.5}, {"velocity_mm_s", 2}}.dump()},
      {"accept-rig", json{{"operator", "A. Lovelace"}}.dump()}};
  const std::string mark(fuzz::kPartMark);
  for (const auto& [name, body] : bodies) {
    seed("api_body", name, body);
    seed("api_http", name,
         "\2POST /v1/" + name.substr(0, name.find('-') == 6 ? std::string::npos : name.find('-')) + mark + body);
  }
  seed("api_http", "accept", "\2POST /v1/accept-rig" + mark + bodies.at("accept-rig"));
  for (const std::string call :
       {"status", "plan", "events?after=3", "readings?window_s=0.5", "calibrations", "runs", "report?run=latest",
        "diagnoses", "page?path=%2Fruns%2Fr%2Freport.html", "experiment?id=x", "selftest", "nothing"})
    seed("api_http", "get-" + call.substr(0, call.find('?')), "\2GET /v1/" + call + mark);
  for (const std::string verb : {"go", "confirm-zero", "seal", "pause", "resume", "abort", "reset"})
    seed("api_http", "verb-" + verb, "\2POST /v1/" + verb + mark);
  seed("api_http", "stop", "\3POST /v1/abort" + mark);
  const std::string twice = "GET /v1/status HTTP/1.1\r\nHost: x\r\n\r\n";
  seed("api_http", "bytes", std::string(1, '\0') + twice + twice);
  seed("api_http", "chunks",
       std::string(1, '\0') + "POST /v1/jog HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n");
  seed("api_http", "expects",
       std::string(1, '\0') + "POST /v1/jog HTTP/1.1\r\nExpect: 100-continue\r\nContent-Length: 2\r\n\r\n{}");
}

/// As the page sends them, and as other sites might.
void pages() {
  const std::string mark(fuzz::kPartMark);
  constexpr char kOwn = 1 | 16, kForeign = kOwn | 4, kNobody = 16;
  for (const std::string path : {"/",
                                 "/live.js",
                                 "/live.css",
                                 "/enter?token=@TOKEN@",
                                 "/enter?token=00",
                                 "/api/library",
                                 "/api/runs",
                                 "/api/calibrations",
                                 "/api/diagnoses",
                                 "/api/selftest",
                                 "/api/zoom?from=0&to=1000000&stretches=100",
                                 "/api/protocol?from=shipped&name=p.toml",
                                 "/api/protocol?from=saved&name=link.toml",
                                 "/api/protocol?from=saved&name=../outside.toml",
                                 "/api/experiment?id=0123456789abcdef",
                                 "/report/20261123-r",
                                 "/report/../outside.toml",
                                 "/page/runs/r/report.html",
                                 "/page/../outside/report.html",
                                 "/live",
                                 "/nothing"}) {
    auto name = "get" + path.substr(0, path.find('?'));
    std::replace(name.begin(), name.end(), '/', '-');
    name += std::to_string(path.size());
    for (const char how : {kOwn, kNobody, static_cast<char>(kOwn | 8)})
      seed("web", name + "-" + std::to_string(how), how + ("GET " + path) + mark);
  }
  const auto protocol = slurp(test::source_path("/config/protocols/vma-smoke.toml"));
  const std::map<std::string, json> bodies{
      {"abort", json::object()},
      {"pause", json::object()},
      {"lease", {{"action", "take"}}},
      {"leave", json::object()},
      {"reset", json::object()},
      {"check", {{"protocol", protocol}, {"protocol_name", "p.toml"}}},
      {"save", {{"name", "mine.toml"}, {"protocol", protocol}, {"replaces", ""}}},
      {"note", {{"run", "latest"}, {"text", "wrong label"}, {"specimen_file", "s.toml"}}},
      {"twin", {{"model_file", "m.toml"}, {"on_parting", "mark"}}},
      {"start", {{"operator", "A"}, {"protocol", protocol}, {"specimen_file", ""}}},
      {"preview",
       {{"operator", "A"}, {"protocol_file", "p.toml"}, {"protocol_from", "shipped"}, {"specimen_file", "s.toml"}}}};
  for (const auto& [verb, body] : bodies) {
    for (const char how : {kOwn, kForeign, kNobody})
      seed("web", verb + "-" + std::to_string(how), how + ("POST /api/" + verb) + mark + body.dump());
  }
  const std::string ping("\x89\x04ping", 6), close("\x88\x02\x03\xe8", 4), words("\x81\x05hello", 7);
  for (const char how : {static_cast<char>(32), static_cast<char>(33), static_cast<char>(36), static_cast<char>(40)})
    seed("web", "live-" + std::to_string(how), how + ping + words + close);
  seed("web", "frames", std::string(1, 33) + "\xff\x82\xfe\x04\x01" + std::string(1100, 'x'));
  seed("web", "bytes",
       std::string(1, 64) + "GET / HTTP/1.1\r\nHost: localhost\r\n\r\nHEAD / HTTP/1.1\r\nHost: [::1]\r\n\r\n");
  seed("web", "chunks",
       std::string(1, 64) +
           "POST /api/abort HTTP/1.1\r\nHost: localhost\r\nOrigin: http://localhost\r\n"
           "Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: %s OUT\n", argv[0]);
    return 2;
  }
  out = argv[1];
  fs::remove_all(out);
  repository();
  models();
  other_programs();
  wires();
  run_logs();
  samples();
  calls();
  pages();
  return 0;
}
