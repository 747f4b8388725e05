// A stand-in for rclcpp, for tests only: it prints errors.
#pragma once

#include <cstdio>
#include <memory>
#include <string>

namespace rclcpp {

struct Logger {
    std::string name;
};

inline Logger get_logger(const std::string& name) { return {name}; }

struct Node {
    using SharedPtr = std::shared_ptr<Node>;
};

}  // namespace rclcpp

#define RCLCPP_ERROR(logger, ...) ((void)(logger), std::printf("error: "), std::printf(__VA_ARGS__), std::puts(""))
#define RCLCPP_DEBUG(logger, ...) ((void)(logger), (void)std::snprintf(nullptr, 0, __VA_ARGS__))
