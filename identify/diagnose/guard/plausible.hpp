#pragma once
#include <optional>
#include <span>
#include <string>

#include "identify/diagnose/guard/guard.hpp"
#include "identify/diagnose/signal/channel_quality.hpp"
#include "messages/recording.hpp"
#include "model/composed.hpp"

namespace isorig::identify {

/// Throws std::invalid_argument for a recording whose numbers are readable and cannot be right: a sign turned round, a
/// length in metres, a force that is one number, strokes that pass between two readings. A fit would explain each of
/// them by physics. `position_quality` is how well the position was read.
void refuse_implausible(const messages::Recording& recording, const std::string& name, const model::ModelSpec& nominal,
                        const ChannelQuality& position_quality);

/// Throws std::invalid_argument where two recordings hold the same samples, or for the most part the same readings at
/// other times (messages::share_readings), with the names of both. Read twice, the rows that are left out of a fit have
/// their copies in it, and every name looks surer than it is.
void refuse_repeated(std::span<const messages::Recording> recordings, std::span<const std::string> names);

/// Throws std::invalid_argument for recordings at several nominal pressures, with the recordings of each. Stiffness,
/// relaxation and tare of an actuator all follow its pressure (Chou & Hannaford 1996), and one material for all
/// pressures differs from the recordings by effects that are not there. Pressures within 5 % of the highest are one. A
/// nominal model that is driven by the pressure has what the others lack, and is not refused.
void refuse_several_pressures(std::span<const messages::Recording> recordings, std::span<const std::string> names,
                              const model::ModelSpec& nominal);

/// A warning where the recordings are of several specimens, by the names of all of them; "" where they are of one.
[[nodiscard]] std::string several_specimens(std::span<const std::string> specimens);

/// Throws std::invalid_argument where no reading of the pressure belongs to any row of the frame.
void refuse_two_clocks(const messages::Recording& recording, const std::string& name);

/// A pressure that stands far from the nominal one all the time: another unit, or a wrong number in
/// recording.toml.
[[nodiscard]] std::optional<DataFault> odd_pressure(const messages::Recording& recording);

}  // namespace isorig::identify
