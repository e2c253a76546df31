#pragma once

namespace isorig::identify {

/// What has which colour of report::Series in the figures of a diagnosis.
inline constexpr int kNominal = 0, kModel = 1, kNoise = 2, kMeasured = 7;

}  // namespace isorig::identify
