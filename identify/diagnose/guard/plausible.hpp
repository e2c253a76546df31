#pragma once
#include <optional>
#include <string>

#include "identify/diagnose/guard/guard.hpp"
#include "messages/recording.hpp"
#include "model/composed.hpp"

namespace isorig::identify {

/// Throws std::invalid_argument for a recording that reads well and cannot be meant: a sign turned round, a
/// length in metres, strokes that pass between two readings. Fitted, each of them would come back as physics.
void refuse_implausible(const messages::Recording& recording, const std::string& name, const model::ModelSpec& nominal);

/// A pressure that stands far from the nominal one all the time: another unit, or a wrong number in
/// recording.toml.
[[nodiscard]] std::optional<DataFault> odd_pressure(const messages::Recording& recording);

}  // namespace isorig::identify
