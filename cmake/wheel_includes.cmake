# The ROS 2 wheels' exported targets name include folders of the machine that built the wheels, and CMake stops at a
# path that does not exist. Passed as CMAKE_PROJECT_INCLUDE, this drops those paths and changes no installed file.
# A ROS 2 installation does not need it.
function(_drop_wheel_includes)
  get_property(_targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(_target IN LISTS _targets)
    get_target_property(_includes ${_target} INTERFACE_INCLUDE_DIRECTORIES)
    if(_includes)
      list(FILTER _includes EXCLUDE REGEX "^/opt/python/")
      set_target_properties(${_target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${_includes}")
    endif()
  endforeach()
endfunction()
cmake_language(DEFER CALL _drop_wheel_includes)
