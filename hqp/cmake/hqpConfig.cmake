# The kernel as a header-only library: find_package(hqp) gives the target hqp::kernel.
# cmake -Dhqp_DIR=$(hqp --cmake-dir) ..., then #include <lexicographic.hpp>
get_filename_component(hqp_INCLUDE_DIR "${CMAKE_CURRENT_LIST_DIR}/../cpp/solver" ABSOLUTE)
if(NOT EXISTS "${hqp_INCLUDE_DIR}/lexicographic.hpp")
  set(hqp_FOUND FALSE)
  set(hqp_NOT_FOUND_MESSAGE "no headers in ${hqp_INCLUDE_DIR}")
  return()
endif()
if(NOT TARGET hqp::kernel)
  add_library(hqp::kernel INTERFACE IMPORTED)
  set_target_properties(hqp::kernel PROPERTIES
    INTERFACE_INCLUDE_DIRECTORIES "${hqp_INCLUDE_DIR}"
    INTERFACE_COMPILE_FEATURES cxx_std_17)
  # the name of the kernel's namespace for one instruction set; compile with -mavx2 -mfma for the fast one
  set_property(TARGET hqp::kernel PROPERTY INTERFACE_COMPILE_DEFINITIONS HQP_ISA=library)
endif()
