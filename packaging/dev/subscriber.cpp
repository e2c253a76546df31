// Prints what the daemon publishes, and says when a message was missed.
//   c++ -std=c++17 subscriber.cpp $(pkg-config --cflags --libs isorig-msgs) -o subscriber
#include <cstdio>
#include <isorig/channels.hpp>
#include <isorig_msgs/frame_batch_t.hpp>
#include <lcm/lcm-cpp.hpp>
#include <string>

struct Subscriber {
  std::int64_t next_number = -1;

  void on_frame(const lcm::ReceiveBuffer*, const std::string&, const isorig_msgs::frame_batch_t* m) {
    if (next_number >= 0 && m->number > next_number) {
      std::printf("missed %lld messages\n", static_cast<long long>(m->number - next_number));
    }
    // A little smaller: late, of a network that reorders (logger.cpp takes it back). Far smaller: a new daemon.
    if (m->number >= next_number || next_number - m->number > 64) next_number = m->number + 1;
    if (m->count > 0) {
      std::printf("%.6f s  %.4f mm  %.3f N\n", 1e-9 * static_cast<double>(m->mono_ns), m->position_mm[0],
                  m->force_N[0]);
    }
  }
};

int main() {
  lcm::LCM lcm("udpm://239.255.76.67:7667?ttl=0&recv_buf_size=4194304");
  if (!lcm.good()) return 1;
  Subscriber subscriber;
  const std::string channel(isorig::messages::name_of(isorig::messages::Channel::kFrame));
  lcm.subscribe(channel, &Subscriber::on_frame, &subscriber)->setQueueCapacity(0);
  while (lcm.handle() == 0) {
  }
}
