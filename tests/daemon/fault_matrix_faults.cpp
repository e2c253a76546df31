#include "fault_matrix_faults.hpp"

namespace isorig::daemon::test {
namespace {

using R = StruckRig;
using Verb = Request::Verb;

sim::FrameFaults& frame(R& r) {
  return r.plant().frame().faults;
}
sim::PressureFaults& sensor(R& r) {
  return r.plant().pressure().faults;
}
sim::Pneumatics& air(R& r) {
  return r.plant().pneumatics();
}

constexpr const char* kLink = "The frame's link (Modbus, ASCII lines)";
constexpr const char* kMotion = "The frame's motion";
constexpr const char* kStop = "The stop";
constexpr const char* kCell = "Load cell and reference";
constexpr const char* kSerial = "The Teensy's link";
constexpr const char* kSensor = "Pressure sensor and its tube";
constexpr const char* kAir = "Valves, hoses, supply";
constexpr const char* kChain = "Interlock";
constexpr const char* kHost = "The machine that isorigd runs on";

const Fault kFaults[] = {
    {kLink, "FrameAnswerLost", "one answer is lost", [](R& r, bool on) { frame(r).polls_lost = on ? 1 : 0; }},
    {kLink, "FrameAnswerSpoilt", "one answer is no answer (CRC, length, unit)",
     [](R& r, bool on) { frame(r).polls_spoilt = on ? 1 : 0; }},
    {kLink, "FrameException", "one answer is an exception", [](R& r, bool on) { frame(r).polls_refused = on ? 1 : 0; }},
    {kLink, "FrameFourLost", "four answers in a row are lost",
     [](R& r, bool on) { frame(r).polls_lost = on ? 4 : 0; }},
    {kLink, "FrameFiveLost", "five answers in a row are lost: connected afresh, which stops the frame",
     [](R& r, bool on) { frame(r).polls_lost = on ? 5 : 0; }},
    {kLink, "FrameSilent", "no answer any more", [](R& r, bool on) { frame(r).silent = on; }},
    {kLink, "FrameSpoiltForGood", "every answer is no answer", [](R& r, bool on) { frame(r).polls_spoilt = on ? -1 : 0; }},
    {kLink, "FrameExceptions", "every answer is an exception", [](R& r, bool on) { frame(r).polls_refused = on ? -1 : 0; }},
    {kLink, "FrameDisconnected", "the connection is cut", [](R& r, bool on) { frame(r).disconnected = on; }},
    {kLink, "FrameSamplesFrozen", "the sample counter stands, the state goes on",
     [](R& r, bool on) { frame(r).frozen_samples = on; }},
    {kLink, "FrameRegistersFrozen", "all registers stand behind a gateway that answers",
     [](R& r, bool on) { frame(r).frozen_registers = on; }},
    {kLink, "FrameNotANumber", "the force is no number", [](R& r, bool on) { frame(r).not_a_number = on; }},
    {kLink, "FrameHeartbeatRefused", "the heartbeat is refused", [](R& r, bool on) { frame(r).heartbeat_refused = on; }},
    {kLink, "FrameClockJumps", "the frame's clock is set on by 3 s",
     [](R& r, bool on) { if (on) r.plant().frame().jump_clock(3e6); }},

    {kMotion, "SegmentRefused", "segments are refused", [](R& r, bool on) { frame(r).segments_refused = on ? -1 : 0; }, 0.0, {}, true},
    {kMotion, "SegmentEchoedWrong", "a segment is taken with another target", [](R& r, bool on) { frame(r).echoes_wrong = on; }, 0.0, {}, true},
    {kMotion, "SegmentIgnored", "segments are echoed and not done", [](R& r, bool on) { frame(r).ignores_segments = on; }, 0.0, {}, true},
    {kMotion, "NeverReached", "arrives and goes on to say \"moving\"", [](R& r, bool on) { frame(r).never_reached = on; }},
    {kMotion, "Overshoots", "stops 0.5 mm beyond the target and says reached",
     [](R& r, bool on) { frame(r).overshoot_mm = on ? 0.5 : 0.0; }, 0.0, {}, true},
    {kMotion, "RunsAway", "runs on beyond the target", [](R& r, bool on) { frame(r).overshoot_mm = on ? 20.0 : 0.0; }, 0.0, {}, true},
    {kMotion, "DriveTrips", "the drive trips", [](R& r, bool on) { frame(r).drive_fault = on; }},
    {kMotion, "FaultState", "the frame's state is \"fault\", no bit says why", [](R& r, bool on) { frame(r).fault_state = on; }},

    {kStop, "StopBusy", "a pause is refused three times", [](R& r, bool on) { frame(r).stop_refused = on ? 3 : 0; }, 0.0, Verb::kPause},
    {kStop, "StopRefused", "a pause is refused for good", [](R& r, bool on) { frame(r).stop_refused = on ? -1 : 0; }, 0.0, Verb::kPause},
    {kStop, "StopLostOnce", "a pause is acknowledged and lost", [](R& r, bool on) { frame(r).stop_lost = on ? 1 : 0; }, 0.0, Verb::kPause},
    {kStop, "StopLost", "every stop is acknowledged and lost", [](R& r, bool on) { frame(r).stop_lost = on ? -1 : 0; }, 0.0, Verb::kPause},
    {kStop, "StopNotDone", "says \"stopped\" and goes on", [](R& r, bool on) { frame(r).runs_on = on; }, 0.0, Verb::kPause},

    {kCell, "CellUnplugged", "the force reading stands", [](R& r, bool on) { frame(r).frozen_force = on; }},
    {kCell, "CellOffScale", "the force reads 250 N too much", [](R& r, bool on) { frame(r).force_error_N = on ? 250.0 : 0.0; }},
    {kCell, "CellOffScaleLow", "the force reads 250 N too little", [](R& r, bool on) { frame(r).force_error_N = on ? -250.0 : 0.0; }},
    {kCell, "FrameRestarts", "the frame is switched off and on: another zero, 0.5 mm away",
     [](R& r, bool on) { r.plant().frame().power_cycle(on ? 0.5 : -0.5); }},

    {kSerial, "SamplesLost", "20 samples never come", [](R& r, bool on) { sensor(r).samples_lost = on ? 20 : 0; }},
    {kSerial, "SamplesCorrupt", "20 frames come corrupt", [](R& r, bool on) { sensor(r).samples_spoilt = on ? 20 : 0; }},
    {kSerial, "TeensyDelay", "silent for 0.1 s", [](R& r, bool on) { sensor(r).silent = on; }, 0.1},
    {kSerial, "TeensySilent", "silent for good", [](R& r, bool on) { sensor(r).silent = on; }},
    {kSerial, "TeensyCorruptForGood", "every frame comes corrupt", [](R& r, bool on) { sensor(r).samples_spoilt = on ? -1 : 0; }},
    {kSerial, "TeensyUnplugged", "unplugged", [](R& r, bool on) { sensor(r).disconnected = on; }},
    {kSerial, "TeensyReboots", "reboots: away for 0.6 s, vents, clock and counter from 0",
     [](R& r, bool on) {
       sensor(r).disconnected = on;
       if (on) r.plant().pressure().power_cycle();
     },
     0.6},
    {kSerial, "TeensyClockJumps", "its clock jumps on by 3 s", [](R& r, bool on) { if (on) r.plant().pressure().jump_clock(3e6); }},

    {kSensor, "SensorStale", "status \"stale\" for good", [](R& r, bool on) { sensor(r).sensor_stale = on; }},
    {kSensor, "SensorDiagnostic", "status \"fault\"", [](R& r, bool on) { sensor(r).sensor_fault = on; }},
    {kSensor, "SensorFrozen", "converts no more", [](R& r, bool on) { sensor(r).frozen_samples = on; }},
    {kSensor, "SensorStuck", "one and the same count", [](R& r, bool on) { sensor(r).stuck_value = on; }},
    {kSensor, "SensorRailLow", "its line is shorted: zeros", [](R& r, bool on) { sensor(r).bus_low = on; }},
    {kSensor, "SensorRailHigh", "its line is open: ones", [](R& r, bool on) { sensor(r).bus_high = on; }},
    {kSensor, "SensorDrifts", "its zero runs away by 0.05 psi/s", [](R& r, bool on) { sensor(r).drift_psi_s = on ? 0.05 : 0.0; }},
    {kSensor, "TubeOff", "the tube comes off the sensor", [](R& r, bool on) { sensor(r).tube_off = on; }},
    {kSensor, "TubeBlocked", "the tube is blocked", [](R& r, bool on) { sensor(r).tube_blocked = on; }},
    {kSensor, "TubeKinked", "the tube is kinked: the reading lags by 2 s", [](R& r, bool on) { sensor(r).tube_lag_ms = on ? 2000 : 0; }},
    {kSensor, "ReadsLow", "reads a fifth too little at once", [](R& r, bool on) { sensor(r).low_permille = on ? 200 : 0; }},

    {kAir, "FillStuckOpen", "the fill valve stays open", [](R& r, bool on) { air(r).fill_stuck_open = on; }},
    {kAir, "FillStuckShut", "the fill valve stays shut", [](R& r, bool on) { air(r).fill_stuck_shut = on; }},
    {kAir, "VentStuckOpen", "the vent valve stays open", [](R& r, bool on) { air(r).vent_stuck_open = on; }},
    {kAir, "VentStuckShut", "the vent valve stays shut", [](R& r, bool on) { air(r).vent_stuck_shut = on; }},
    {kAir, "DumpStuckShut", "the dump valve stays shut", [](R& r, bool on) { air(r).dump_stuck_shut = on; }},
    {kAir, "CommandsLost", "valve commands are lost", [](R& r, bool on) { sensor(r).ignores_commands = on; }},
    {kAir, "HoseBursts", "a hose bursts, 150 mL/s/bar", [](R& r, bool on) { air(r).burst_mL_s_bar = on ? 150.0 : 0.0; }},
    {kAir, "SupplyEmpty", "the supply is empty", [](R& r, bool on) { air(r).supply_empty = on; }},
    {kAir, "SupplyHigh", "the supply's regulator is turned up to 90 psi", [](R& r, bool on) { air(r).supply_psi_now = on ? 90.0 : 0.0; }},

    {kChain, "EmergencyStop", "the emergency stop is pressed", [](R& r, bool on) { r.plant().interlock().estop_closed = !on; }},
    {kChain, "GuardOpens", "the guard opens", [](R& r, bool on) { r.plant().interlock().guard_closed = !on; }},
    {kChain, "InputsLost", "the inputs cannot be read", [](R& r, bool on) { r.plant().interlock().faulty = on; }},
    {kChain, "ContactBounces", "the emergency stop opens for 20 ms", [](R& r, bool on) { r.plant().interlock().estop_closed = !on; }, 0.02},

    {kHost, "LoopLate", "the loop comes 0.4 s late (a CPU hog)", [](R& r, bool on) { r.late_ns = on ? 400'000'000 : 0; }},
    {kHost, "LoopALittleLate", "the loop comes 0.05 s late", [](R& r, bool on) { r.late_ns = on ? 50'000'000 : 0; }},
    {kHost, "LoopHangs", "the loop hangs for 1 s, the device threads live", [](R& r, bool on) {
       r.rig().hang_core = on;
       if (!on) r.late_ns = 1'000'000'000;
     }, 1.0},
    {kHost, "Stopped", "SIGSTOP for 1 s, then SIGCONT", [](R& r, bool on) {
       r.rig().hang_all = on;
       if (!on) r.late_ns = 1'000'000'000;
     }, 1.0},
    {kHost, "DiskFull", "the disk is full", [](R& r, bool on) { r.disk_full = on; }},
    {kHost, "DiskHangs", "the disk hangs", [](R& r, bool on) { r.disk_hangs = on; }},
    {kHost, "DiskSlow", "the disk takes 5 s for a write", [](R& r, bool on) { r.disk_hangs = on; }, 5.0},
};

}  // namespace

std::span<const Fault> faults() {
  return kFaults;
}

}  // namespace isorig::daemon::test
