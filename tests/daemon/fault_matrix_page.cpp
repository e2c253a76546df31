#include <array>
#include <cmath>
#include <cstdio>
#include <map>
#include <string_view>

#include "fault_matrix_expect.hpp"

/// docs/faults.md from the table that the test holds the rig to.
namespace isorig::daemon::test {
namespace {

using Kind = Expected::Kind;

constexpr const char* kHead = R"(# Every fault in every kind of step

Generated: `build/bin/fault_matrix_page > docs/faults.md`; `FaultMatrixPage.IsUpToDate` compares. Each fault below strikes in each
situation, on the simulated rig in virtual time: the daemon's own core, services and recorder on the plant of
[simulated-rig.md](simulated-rig.md) (`config/rigs/sim.toml`, with 10 mL between regulator and fill valve). `FaultMatrix.EveryCellEndsAsThePageSays`
plays a fault's row; all rows take about 50 s of one core. What the codes mean: [states.md](states.md); what acts when no program does:
[safety.md](safety.md).

A cell is held to this, by the plant's true motion, force and pressure at every millisecond, and never by what the daemon says of them:

| | bound | from |
|---|---|---|
| found | as the row says, from the moment of the fault | age limits of 0.25 s and two polls; the pressure guard's sums; for motions the rest of the stroke is in it |
| the crosshead stands | 0.3 s after it was found, however long that took; 0.82 s after the fault where the frame is not reached or does not obey | a stop from 10 mm/s is confirmed within 0.28 s; the frame's watchdog of 0.5 s, its brake of 0.25 s, two polls |
| a safe state is vented below 1 psi | 2.5 s after it was found; 6 s where the dump valve cannot be let go of; to 4 psi against a fill valve that stays open | 0.8 s from 20 psi through both valves, 5 s through the vent valve alone; the Teensy's watchdog, 0.5 s |
| a program stop holds | the pressure stays above 85 % of what it was | the chamber leaks 0.54 psi/min at 20 psi |
| travel | beyond where the protocol goes by no more than the permitted following error and the way until it stands | [states.md](states.md), following error |
| force | inside its limits and 5 % of their range | |
| pressure | at most 3 psi above the set-point in force, and 1.5 psi above its limit | the hold's allowance, 0.6 psi, and what a stroke may explain. In force is what the loop goes to at that millisecond, by the ramp of the step; a set-point that falls counts with 0.5 psi/s, by which the vent valve alone is quicker, and not while a program stop holds both valves shut |
| cause | the first fault in the list is one of the codes in the row | |
| severity | safe state or program stop, as [states.md](states.md) has it for the code and the phase | |
| recording | opens, ended in order, as many samples in full and in averages as the recorder counted; what the devices made while the run was open, by their own counters, is in it; the cause is an event in it; 0.9 s before and 1.9 s after it nothing is averaged | 7 samples of the frame and 4 of the Teensy may be on their way when the run is opened and closed: a poll |
| counted as missing | nothing but what the fault takes: the 20 samples that are lost or corrupt; 80 ms of the frame's while five answers are lost and it is connected afresh, 60 ms while it restarts; in a SIGSTOP of 1 s what its ring (256) and the Teensy's (512) do not hold | |
| not counted | what nobody can count: of a link that is still dead when the recording ends, 7.26 s; of a Teensy that counts from 0 again, 0.76 s | a trip after 0.26 s ends the run, which is recorded for 7 s more; connected anew after 0.75 s |
| evidence | `trip-N.json` has the cause, and every sample around it | |
| recovery | the fault repaired: `confirm-zero` where the frame was restarted, `reset`, `resume` of a held run or `abort`, ready, and a new start (where arming is required its two acts and its countdown, too) that fills and moves | |

*Goes on* is as strict: no fault, the same state as without it, the same bounds for force, pressure and travel, and a recording that is whole.
*Not ready* means that the rig says why, in the words of the row, and starts nothing. What is *not seen* goes on likewise, and has its reason.

)";

constexpr const char* kEnds = R"(
## The end of isorigd

`FaultMatrixEnds` ends isorigd in each of the situations, and starts another on the same plant. The bounds above hold, from the signal on.

| | the plant | what is left | the next isorigd |
|---|---|---|---|
| SIGKILL, and another 3 s later | the crosshead stands within 0.82 s by the frame's watchdog, vented within 2.5 s by the Teensy's and by the dump valve, whose line the kernel lets go of | the recording is *interrupted*, and its newest sample no older than [data.md](data.md#what-a-crash-costs) has it | nothing is latched; *idle*, "zero is not confirmed" with the zero of a frame that counts from its start; after `confirm-zero` *ready*; an open run goes on as a further attempt, with what was recorded before as it was; a new start fills and moves |
| SIGKILL with a dump valve that stays shut, and another 7 s later | likewise, vented within 6 s: by the Teensy's watchdog through the vent valve alone | likewise | likewise |
| SIGKILL, and another 0.1 s later, before a watchdog has acted | the crosshead stands 0.31 s after that, vented within 2.5 s of the kill: a new connection stops the frame and vents | likewise | likewise |
| SIGTERM | the crosshead stands within 0.3 s, vented within 2.5 s; so it stays when nobody is there | the recording is ended in order and whole as far as the run came, with `run.aborted` or `run.not_started` | likewise; the run was ended by an operator, and goes on with `--aborted` alone |

What this is not: a process. The recording that a kill leaves is a copy of the files at that millisecond, so that nothing which was still in the
recorder's memory is in it, but the connections of the dead one are not closed by a kernel, and the catalogue is not played. `Kill`, `EndingSignalTest` and
`WireEvents` below have real signals, `isorig runs` and `isorig resume`.
)";

constexpr const char* kWires = R"(
## Over the wires

What virtual time cannot have: bytes, sockets, processes, disks and a real kernel.

| fault | shown by |
|---|---|
| Modbus: delay, drop, wrong answer, exception, late reply, frozen register | `ModbusFaults.DelaysBelowTheTimeOutOnlyCostTime`, `ModbusTimeOuts.ADroppedReplyIsATimeOut`, `ModbusTimeOuts.ADamagedReplyIsNotBelieved`, `ModbusTimeOuts.ALateReplyIsNeverTheNextAnswer`, `ModbusFaults.TheFramesOwnRefusalComesThrough`, `ModbusFaults.AFrozenFrameGivesNoSamplesAndNoTime` |
| Modbus: connection cut, another frame, a frame that was restarted, a target that was clamped | `ModbusReconnect.ALostConnectionLosesNoSample`, `ModbusFaults.AnotherFrameIsNotAccepted`, `ModbusFaults.ARestartedFrameIsNotTakenForTheOldOne`, `ModbusFaults.AClampedTargetIsFoundAndStopped` |
| ASCII lines of the 8800: lost, damaged, late, unasked for, commands lost | `Instron8800LineUnderway.IsBackInStep`, `Instron8800Line.AtConnectStartAndStop`, `Instron8800LostCommand.IsNoticed`, `Instron8800Storm.IsOverWhenItIsOver` |
| a stop that is refused, busy, lost, cut, silent or late, on three kinds of line | `StopWire.EndsInStandstillWithinTheFramesWatchdog`, `WireEvents.AStopThatIsNotTakenIsASafeStateUntilTheFrameStands` |
| serial: corrupt, truncated, duplicated, lost, reordered replies | `TeensyOnScript.CountsCorruptAndForeignFrames`, `TeensyOnScript.AFrameCutShortByATimeOutDoesNotSpoilTheNext`, `TeensyOnScript.CountsGapsAndDropsRepeats`, `TeensyOnScript.LateRepliesGoToTheirOwnRequests`, `TeensyOnPty.CorruptFramesCostThemselvesOnly` |
| serial: silent, reboot, plug pulled, wrong version or device | `TeensyOnScript.SilenceIsATimeOut`, `TeensyOnScript.ADeviceThatStartsAnewIsNoticed`, `TeensyOnPty.StartsOverAfterThePlugWasPulled`, `TeensyOnScript.RefusesAnotherSerialNumberModelOrVersion` |
| a clock that jumps | `WireEvents.EachCutAndRestartWithinTheAgeLimitIsInTheRecording` |
| the sensor's status bits on the wire | `TeensyOnPty.SensorFaultsArriveAsTheSensorSendsThem` |
| regulator, its driver: late, another unit, set-point clamped, gone | `Regulator.ALateAnswerIsNeverTheNextOne`, `Regulator.SeesAnotherUnit`, `Regulator.ASetpointThatDoesNotArriveIsRefused`, `Regulator.KeepsItsSetpointWhenNobodySpeaksToIt`; any bytes: `fuzz.modbus` |
| regulator, the daemon: silent, another set-point or none, a loop that hangs | `RegulatorServiceTest.OneMissingAnswerIsNoLostConnectionFiveAre`, `RegulatorServiceTest.ASetPointThatSomebodyElseChangedIsAFault`, `RegulatorServiceTest.ASetPointThatIsNoNumberIsAFault`, `RegulatorServiceTest.ALoopThatNoLongerTicksExhausts`; `stale.regulator`, `regulator.fault` and `regulator.disagrees` in every phase: `SupervisorTest.EveryCauseHasTheSeverityOfItsRuleInEveryPhase` |
| regulator, a rig that ramps: gone, reads another pressure | `RigRegulator.IsASafeStateWhenItIsGone`, `RigRegulator.IsASafeStateWhenItReadsAnotherPressure` |
| frame or Teensy gone in a run, and back | `Wire.AFrameThatIsGoneIsASafeStateAndItsReturnIsRecovered`, `Wire.ATeensyThatIsGoneIsASafeState`, `Wire.DelayAndCorruptBytesAreCountedAndTheRunGoesOn` |
| interlock contacts on a kernel: bounce, overflow, chip gone | `GpioOnKernel.ABouncingContactIsOpenUntilItIsQuiet`, `GpioOnKernel.ABurstThatOverflowsTheKernelsQueueEndsOnTheLevel`, `GpioOnKernel.AChipThatVanishesIsFoundAgainUnderAnotherNumber` |
| disk full, failing, read short, pulled | `RecordingFaults.AFullDiskLosesNothing`, `RecordingFaults.AFailedSyncIsFinalAndTheRecordingGoesOnElsewhere`, `RecordingFaults.AShortWriteLosesAndTearsNothing`, `RecordingFaults.ARemovedFolderIsACondition` |
| disk that becomes read-only: in mid-run, before a start | `FailingDisk.ReadOnlyInMidRunIsAProgramStopAndTheRunGoesOnWhenTheDiskIsMended`, `RecordingOnReadOnlyDisk.InMidRunIsHeldInMemoryAndWrittenWhenItIsWritableAgain`, `FailingDisk.ReadOnlyBeforeAStartRefusesItInWordsAndIsNotReady` |
| disk that hangs: in mid-run, before a start | `EndingTest.ARecorderThatHangsIsAProgramStop`, `FailingDisk.HangingBeforeAStartIsNotReadyAndHoldsUpNobody`, `FailingDisk.HangingBetweenRunsKeepsNobodyFromLeaving`, `FailingDisk.HangingInMidRunIsWaitedForAfterOneSignalAndNotAfterTwo` |
| LCM: no route, one that goes in mid-run, a subscriber that is slow | `LcmRoute.ADaemonWithoutOneDoesNotStartAndSaysWhatHelps`, `LcmRoute.OneThatGoesInMidRunIsToldAndCostsTheRecordingNothing`, `Publisher.ASubscriberWithTheDefaultQueueCountsWhatItMissed` |
| memory pressure | `MemoryPressure.CostsNeitherSamplesNorTheRun` |
| a wall clock that is set | `WallClock.SetBackBetweenTwoRunsDatesEachByItselfAndTheSecondIsTheLatest`, `OrderOfRuns.TheLatestIsTheOneThatBeganLastWhateverTheClockSaid` |
| clients killed, slow, in crowds | `EndingTest.NoCrowdOfClientsDelaysAnAbort`, `EndingTest.AnOutputThatNobodyTakesHoldsUpNothing` |
| SIGTERM, SIGINT, SIGHUP; signals that mean nothing | `EndingSignalTest.EndsARunOrderly`, `EndingTest.ASignalStopsTheRigWhileTheDiskHangsAndTheRunIsWrittenLater`, `EndingTest.SignalsThatMeanNothingHereEndNothing` |
| SIGKILL | `Kill.AtAnyMomentLeavesARecordingThatIsToldShortAndRightAsFarAsItGoes`, `GpioOnKernel.TheValveVentsWhenTheProcessIsKilled`, `WireEvents.AKilledRunIsResumedWithEachApproachAndSegmentCarriedOut` |
| a loop that stalls while its threads live | `ServiceManager.AStalledLoopStarvesTheWatchdogWhileEveryOtherThreadLives` |
| all of it on one machine with a real kernel | `RigOnKernel.RunsAProtocolAndMeetsEveryMishapSafely` |

The wall clock is read for dates alone; all that a run measures, decides or is timed by has CLOCK_MONOTONIC ([architecture.md](architecture.md),
one clock). What a wrong date does:

- A run's name, its recording and its evidence have the date that the clock said when the run began; a clock that is set in mid-run dates the next
  run. The live page and the sample socket have the date that the daemon began with, until it is started again. `latest` asks for no
  date. The service waits for a clock that is set where the machine does ([service.md](service.md#dates)).
- A calibration is overdue by today's date: with `[calibration] overdue = "refuse"` a clock that runs ahead refuses starts in words, and one that
  runs behind lets them pass.
- A kernel before 5.7 stamps the edges of GPIO lines with the wall clock. A step between an edge and its reading, 5 ms at most while the thread runs,
  moves the stamp of that edge.

Memory pressure is in the second table: the daemon in a memory cgroup of 24 MiB more than it holds, beside a process that writes and reads a file of 200 MB
and touches 8 MiB over and over. In 13 s the cgroup reaches its limit some 11,000 times (2026-11-28, Linux 6.18, cgroups of version 1, no swap). No sample
is lost, the recording is whole, and the daemon reads no page from a disk: its memory is locked ([threads.md](threads.md)). A limit below what is locked
(24 MiB) killed the daemon as it began; what follows from that is the row SIGKILL.
)";

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

std::string outcome(const Expected& e) {
  switch (e.kind) {
    case Kind::kTrips: {
      std::string all;
      for (const auto& code : e.codes) all += (all.empty() ? "`" : " or `") + code + "`";
      return all;
    }
    case Kind::kNotReady:
      return "not ready: \"" + e.codes.front() + "\"";
    case Kind::kStandsDown:
      return "back to rest, without a fault";
    case Kind::kRides:
      return "goes on";
    case Kind::kUnseen:
      return "not seen: " + e.why;
    case Kind::kImpossible:
      return "not played: " + e.why;
  }
  return {};
}

std::string rows_of(const Fault& fault) {
  // What ends alike stands in one line, in the order of the situations.
  std::vector<std::pair<std::string, std::string>> lines;
  for (unsigned i = 0; i < kSituations; ++i) {
    const auto& e = expected(fault, static_cast<At>(i));
    const std::string how = outcome(e) + " | " + (e.kind == Kind::kTrips ? number(e.within_s) + " s" : std::string());
    auto line = lines.begin();
    while (line != lines.end() && line->first != how) ++line;
    if (line == lines.end()) line = lines.insert(line, {how, {}});
    line->second += (line->second.empty() ? "" : ", ") + std::string(situation(static_cast<At>(i)).name);
  }
  std::string all;
  for (const auto& [how, where] : lines) {
    all += "| " + std::string(all.empty() ? fault.words : "") + " | " +
           (lines.size() == 1 ? std::string("everywhere") : where) + " | " + how + " |\n";
  }
  return all;
}

}  // namespace

const char* to_text(Expected::Kind kind) {
  switch (kind) {
    case Kind::kTrips:
      return "trips";
    case Kind::kNotReady:
      return "not ready";
    case Kind::kStandsDown:
      return "back to rest";
    case Kind::kRides:
      return "goes on";
    case Kind::kUnseen:
      return "not seen";
    case Kind::kImpossible:
      return "not played";
  }
  return "";
}

std::string faults_page() {
  std::string page = kHead;
  page += "| situation | what the rig does when the fault strikes |\n|---|---|\n";
  for (unsigned i = 0; i < kSituations; ++i) {
    const auto& s = situation(static_cast<At>(i));
    page += std::string("| ") + s.name + " | " + s.meaning + " |\n";
  }
  page +=
      "| `mark` | not played: it takes no time |\n| calibrating, tare | the state is *ready*: the host averages "
      "readings, "
      "the loop does nothing else |\n\n";
  std::map<Kind, int> counts;
  for (const auto& f : faults()) {
    for (unsigned i = 0; i < kSituations; ++i) ++counts[expected(f, static_cast<At>(i)).kind];
  }
  page += std::to_string(faults().size()) + " faults in " + std::to_string(kSituations) + " situations are " +
          std::to_string(faults().size() * kSituations) + " cells: ";
  for (const auto& [kind, count] : counts) {
    page += std::to_string(count) + " " + to_text(kind) + (kind == counts.rbegin()->first ? ".\n" : ", ");
  }
  std::string_view group;
  for (const auto& f : faults()) {
    if (group != f.group) {
      group = f.group;
      page += "\n## " + std::string(group) + "\n\n| fault | in | ends as | found within |\n|---|---|---|---|\n";
    }
    page += rows_of(f);
  }
  return page + kEnds + kWires;
}

}  // namespace isorig::daemon::test
