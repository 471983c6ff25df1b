// SPDX-License-Identifier: BSD-3-Clause
// The roscpp side of the UDPROS benchmark: one end of a topic, controlled by commands on stdin, see udpros_peer.py.
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <smokebot_udp/ImageSegment.h>
#include <sys/resource.h>

#include <algorithm>
#include <iostream>
#include <mutex>
#include <vector>

static double cpu()
{
  rusage u;
  getrusage(RUSAGE_SELF, &u);
  return u.ru_utime.tv_sec + u.ru_stime.tv_sec + 1e-6 * (u.ru_utime.tv_usec + u.ru_stime.tv_usec);
}

static std::mutex lock;
static std::vector<double> ages;

static void receive(const smokebot_udp::ImageSegment::ConstPtr& message)
{
  const double age = (ros::Time::now() - message->header.stamp).toSec();
  std::lock_guard<std::mutex> guard(lock);
  ages.push_back(age);
}

int main(int argc, char** argv)
{
  const std::string role = argv[1], topic = argv[2];
  ros::init(argc, argv, "roscpp_" + role, ros::init_options::NoSigintHandler);
  ros::NodeHandle node;
  ros::Publisher publisher;
  ros::Subscriber subscriber;
  if (role == "send")
    publisher = node.advertise<smokebot_udp::ImageSegment>(topic, 1000);
  else
    subscriber = node.subscribe(topic, 100000, receive, ros::TransportHints().unreliable().maxDatagramSize(1472));
  ros::AsyncSpinner spinner(1);
  spinner.start();
  while (ros::ok() && (role == "send" ? publisher.getNumSubscribers() : subscriber.getNumPublishers()) == 0)
    ros::WallDuration(0.01).sleep();
  std::cout << "ready" << std::endl;
  smokebot_udp::ImageSegment message;
  message.encoding = "mono8";
  message.data.resize(1400);
  double begun = 0;
  std::string word;
  while (std::cin >> word)
  {
    if (word == "begin")
    {
      std::lock_guard<std::mutex> guard(lock);
      ages.clear();
      begun = cpu();
      std::cout << "ok" << std::endl;
    }
    else if (word == "send")
    {
      double rate, seconds;
      std::cin >> rate >> seconds;
      const double before = cpu();
      const ros::WallTime begun = ros::WallTime::now();
      long sent = 0, ticks = 0;
      ros::WallTime due = ros::WallTime::now();
      for (; ticks < seconds * 1000; ++ticks, due += ros::WallDuration(0.001))
      {
        const ros::WallDuration left = due - ros::WallTime::now();
        if (left > ros::WallDuration(0))   // a negative sleep never ends
          left.sleep();
        for (const long until = rate * (ticks + 1) / 1000; sent < until; ++sent)
        {
          message.header.stamp = ros::Time::now();
          publisher.publish(message);
        }
      }
      const double took = (ros::WallTime::now() - begun).toSec();
      ros::WallDuration(0.2).sleep();
      std::cout << "{\"sent\": " << sent << ", \"seconds\": " << took << ", \"cpu\": " << cpu() - before << "}" << std::endl;
    }
    else if (word == "report")
    {
      std::lock_guard<std::mutex> guard(lock);
      const double used = cpu() - begun;
      std::sort(ages.begin(), ages.end());
      const size_t n = ages.size();
      std::cout << "{\"received\": " << n << ", \"cpu\": " << used << ", \"p50\": " << (n ? ages[n / 2] : 0)
                << ", \"p99\": " << (n ? ages[n * 99 / 100] : 0) << "}" << std::endl;
    }
  }
}
