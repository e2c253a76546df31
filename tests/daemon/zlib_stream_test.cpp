#include "daemon/export/zlib_stream.hpp"

#include <gtest/gtest.h>
#include <zlib.h>

#include <cmath>
#include <cstring>
#include <random>
#include <stdexcept>
#include <vector>

namespace isorig::daemon::testing {
namespace {

using Bytes = std::vector<std::uint8_t>;

/// Read by zlib itself, which has to find its end where the stream ends.
Bytes inflated(const Bytes& stream, std::size_t expected) {
  Bytes out(expected + 1);
  z_stream z{};
  if (inflateInit(&z) != Z_OK) throw std::runtime_error("zlib");
  z.next_in = const_cast<Bytef*>(stream.data());
  z.avail_in = static_cast<uInt>(stream.size());
  z.next_out = out.data();
  z.avail_out = static_cast<uInt>(out.size());
  const int ended = inflate(&z, Z_FINISH);
  const auto left = z.avail_in;
  out.resize(z.total_out);
  inflateEnd(&z);
  if (ended != Z_STREAM_END || left != 0) throw std::runtime_error("no whole zlib stream");
  return out;
}

Bytes noise(std::size_t size) {
  std::mt19937_64 random(11);
  Bytes out(size);
  for (auto& b : out) b = static_cast<std::uint8_t>(random());
  return out;
}

/// A stroke in thousandths of a millimetre, as an export has it.
Bytes stroke(std::size_t rows) {
  std::vector<double> values(rows);
  for (std::size_t i = 0; i < rows; ++i)
    values[i] = std::round(4000.0 * std::sin(1e-3 * static_cast<double>(i))) * 1e-3;
  Bytes out(rows * sizeof(double));
  std::memcpy(out.data(), values.data(), out.size());
  return out;
}

Bytes compressed(ZlibStream& zlib, const Bytes& in, std::size_t piece) {
  Bytes out;
  const ZlibStream::Sink sink = [&](std::span<const std::uint8_t> s) { out.insert(out.end(), s.begin(), s.end()); };
  const std::span<const std::uint8_t> all(in);
  std::size_t at = 0;
  for (; in.size() - at > piece; at += piece) zlib.add(all.subspan(at, piece), false, sink);
  zlib.add(all.subspan(at), true, sink);
  return out;
}

TEST(ZlibStream, ZlibReadsWhatWasWrittenInPiecesOfAnySize) {
  ZlibStream zlib;  // one for all of them: each begins afresh
  for (const auto& in : {Bytes{}, Bytes{7}, Bytes(1'000'000, 0), noise(300'000), stroke(100'000)}) {
    for (const std::size_t piece : {std::size_t{1'000}, std::size_t{65'536}, std::size_t{1} << 20U}) {
      EXPECT_TRUE(inflated(compressed(zlib, in, piece), in.size()) == in) << in.size() << " bytes by " << piece;
    }
  }
}

/// Noise grows by the headers of stored blocks alone (5 bytes in 65,535 and less at the ends); a stroke shrinks.
TEST(ZlibStream, NoiseHardlyGrowsAndAStrokeShrinks) {
  ZlibStream zlib;
  EXPECT_LT(compressed(zlib, noise(300'000), 300'000).size(), 300'000U + 300'000U / 1'000U);
  EXPECT_LT(compressed(zlib, stroke(100'000), 800'000).size(), 400'000U);
}

}  // namespace
}  // namespace isorig::daemon::testing
