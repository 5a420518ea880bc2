# A bare-metal Cortex-M7 with its double-precision floating-point unit, run in QEMU:
#   cmake -S . -B build_m7 -DCMAKE_TOOLCHAIN_FILE=cortex_m7/toolchain.cmake && cmake --build build_m7
#   ctest --test-dir build_m7 --output-on-failure
# Needs arm-none-eabi-gcc with newlib, and qemu-system-arm for ctest.
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR cortex-m7)
set(CMAKE_C_COMPILER arm-none-eabi-gcc)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
set(CMAKE_C_FLAGS_INIT "-mcpu=cortex-m7 -mthumb -mfpu=fpv5-d16 -mfloat-abi=hard -ffunction-sections -fdata-sections")
set(board "${CMAKE_CURRENT_LIST_DIR}")
# gcc compiles the start-up file while it links a program
set(CMAKE_EXE_LINKER_FLAGS_INIT
    "--specs=rdimon.specs -nostartfiles -Wl,--gc-sections -T \"${board}/mps2_an500.ld\" \"${board}/startup.c\"")
set(CMAKE_CROSSCOMPILING_EMULATOR
    qemu-system-arm -M mps2-an500 -display none -monitor none -serial none
    -semihosting-config enable=on,target=native -kernel)
