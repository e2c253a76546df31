#include <gmock/gmock.h>

#include <algorithm>
#include <map>
#include <set>

#include "calibration/store.hpp"
#include "served_rig.hpp"

/// Several people keep a calibration in the same moment. Each record says which one it follows, so that of two that
/// follow the same one is refused, and one that follows another is kept only when it comes after it.
namespace isorig::daemon::test {
namespace {

using calibration::Channel;
using calibration::Record;
using ::testing::AnyOf;
using ::testing::HasSubstr;

class CalibrationsAtOnce : public ServedRig {
 protected:
  CalibrationsAtOnce() : ServedRig("calibrations") {}
  void SetUp() override { serve(); }
  void TearDown() override { stop_serving(); }

  struct Follows {
    std::string id;
    calibration::Correction correction;
  };
  [[nodiscard]] Follows in_force(Channel channel) const {
    const auto now = host_->calibrations_json()["in_force"][name_of(channel)];
    return {now["id"], {now["scale"], now["offset"]}};
  }

  /// A zero that is off by `offset`, found in minute `minute` of a day.
  [[nodiscard]] Record record_of(Channel channel, int minute, double offset, const Follows& before) const {
    Record r;
    r.rig = config_.name;
    r.channel = channel;
    r.mode = calibration::Mode::kAdjust;
    const auto two_digits = [](int n) { return (n < 10 ? "0" : "") + std::to_string(n); };
    r.made_utc = "2026-11-21T" + two_digits(minute / 60) + ":" + two_digits(minute % 60) + ":00Z";
    r.id = calibration::record_id(r.made_utc, channel);
    r.due = "2999-01-01";
    r.operator_name = "R. Boyle";
    r.supersedes = before.id;
    r.reference = {"gauge-7", "", "2999-01-01", 0.0};
    r.before = before.correction;
    for (const double reference : {0.0, 5.0, 10.0, 15.0, 20.0})
      r.points.push_back({reference, reference - offset, 0, 0});
    r.result = calibration::calibrate(channel, r.mode, r.points, r.before, 0.0);
    return r;
  }
  [[nodiscard]] std::set<std::string> kept() const {
    std::set<std::string> ids;
    const auto now = host_->calibrations_json();
    for (const auto& r : now["records"]) ids.insert(r["id"].get<std::string>());
    return ids;
  }
};

TEST_F(CalibrationsAtOnce, ExactlyThoseThatWereAcceptedAreThereAndEachFollowsTheOneBefore) {
  constexpr int kRounds = 12, kClients = 5;
  std::map<Channel, int> accepted_of;
  for (int round = 0; round < kRounds; ++round) {
    const auto earlier = kept();
    const auto pressure = in_force(Channel::kPressure), force = in_force(Channel::kForce);
    // Two follow the same, one follows the first of them, two follow the same of another channel.
    const int minute = 10 * round;
    const auto first = record_of(Channel::kPressure, minute + 1, 0.001 * (round + 1), pressure);
    const auto rival = record_of(Channel::kPressure, minute + 2, -0.001 * (round + 1), pressure);
    const auto second =
        record_of(Channel::kPressure, minute + 3, 0.05 + 0.001 * round, {first.id, first.result.correction});
    const auto other = record_of(Channel::kForce, minute + 1, 0.01 * (round + 1), force);
    const auto other_rival = record_of(Channel::kForce, minute + 2, -0.01 * (round + 1), force);
    const std::vector<const Record*> posted{&first, &rival, &second, &other, &other_rival};
    std::vector<Answer> answers(kClients);
    at_once(kClients, [&](int i) {
      const auto which = static_cast<std::size_t>((i + round) % kClients);
      answers[which] = call("POST /v1/calibrations", nlohmann::json{{"record", to_toml(*posted[which])}}.dump());
    });

    auto expected = earlier;
    std::map<Channel, const Record*> newest;
    for (std::size_t i = 0; i < posted.size(); ++i) {
      if (answers[i].status == 200) {
        expected.insert(posted[i]->id);
        ++accepted_of[posted[i]->channel];
        auto& last = newest[posted[i]->channel];
        if (last == nullptr || posted[i]->id > last->id) last = posted[i];
      } else {
        EXPECT_EQ(answers[i].status, 409) << answers[i].text();
        EXPECT_THAT(answers[i].text(), AnyOf(HasSubstr("somebody calibrated meanwhile"), HasSubstr("is not younger")));
      }
    }
    EXPECT_EQ(kept(), expected);
    EXPECT_NE(answers[0].status == 200, answers[1].status == 200) << "two follow the same record";
    EXPECT_NE(answers[3].status == 200, answers[4].status == 200) << "two follow the same record";
    if (answers[2].status == 200) {
      EXPECT_EQ(answers[0].status, 200) << "a record follows one that is not there";
    }
    for (const auto& [channel, record] : newest) {
      const auto now = in_force(channel);
      EXPECT_EQ(now.id, record->id);
      EXPECT_EQ(now.correction.offset, record->result.correction.offset);
    }
  }
  EXPECT_GE(accepted_of[Channel::kPressure], kRounds);
  EXPECT_EQ(accepted_of[Channel::kForce], kRounds);

  // On the disk too, one after the other, whole.
  const calibration::Store again(host_->calibrations_json()["directory"].get<std::string>(), {});
  std::set<std::string> on_disk;
  std::map<Channel, std::string> last;
  for (const auto& r : again.records()) {
    EXPECT_EQ(r.supersedes, last[r.channel]) << r.id;
    last[r.channel] = r.id;
    on_disk.insert(r.id);
  }
  EXPECT_EQ(on_disk, kept());
}

}  // namespace
}  // namespace isorig::daemon::test
