#include "drivers/frame/instron8800_status.hpp"

namespace isorig::frame {

const char* describe_instron8800_status(unsigned code) noexcept {
  switch (code) {
    case 0:
    case 15:  // all well
      return nullptr;
    case kInstron8800TravelLimit:
      return "travel limit exceeded";
    case 2:
      return "power amplifier too hot";
    case kInstron8800EmergencyStop:
      return "emergency stop pushed";
    case 7:
      return "oil too hot";
    case 8:
      return "oil level too low";
    case 9:
      return "motor too hot";
    case 10:
      return "oil pressure too high";
    case 11:
      return "oil pressure too low";
    case 12:
      return "manifold or pump blocked";
    case 13:
      return "oil level going too low";
    case 14:
      return "manifold pressure low";
    default:
      return "a fault code this driver does not know";
  }
}

}  // namespace isorig::frame
