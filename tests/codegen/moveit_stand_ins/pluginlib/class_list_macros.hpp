// A stand-in for pluginlib, for tests only: the class is made by a function instead of by name.
#pragma once

#include <memory>

#define PLUGINLIB_EXPORT_CLASS(Class, Base)                                                                            \
    std::unique_ptr<Base> make_plugin() { return std::make_unique<Class>(); }
