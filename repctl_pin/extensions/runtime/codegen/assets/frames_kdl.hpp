/* @about */
#error "arm has several frames, and a chain of Orocos KDL has one tip: use the functions of arm.hpp"
