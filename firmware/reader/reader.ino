// Copyright 2026 retrolidar_ros contributors
// SPDX-License-Identifier: Apache-2.0
//
// The reader: a NUCLEO-F401RE with an X-NUCLEO-53L8A1 (the kit P-NUCLEO-53L8A1), its jumpers J7, J8
// and J9 on SPI. It sends each frame of the VL53L8CX as protocol 1 over the board's USB, and obeys
// the lines identify, start, stop and reset.
//
// Libraries: STM32duino VL53L8CX 2.1.0, and ../core. Flags of the build: build_opt.h.

#include <SPI.h>
#include <retrolidar_command.h>
#include <retrolidar_wire.h>
#include <vl53l8cx.h>

#if !defined(VL53L8CX_USE_RAW_FORMAT) || SERIAL_TX_BUFFER_SIZE < 1024
#error "build_opt.h must lie beside this sketch: it sets the raw format and a buffer for a frame"
#endif

constexpr uint8_t VERSION[3] = {0, 1, 0};
// 4 for the frames that markers are read from; 8 for finer bearings at 15 Hz, and bits of 133 ms.
constexpr uint8_t ROWS = 4;
// 20.8 ms a frame, as near to the paper's 21 ms as whole hertz come; 15 is the limit of 8x8.
constexpr uint8_t RATE_HZ = ROWS == 4 ? 48 : 15;
// The sensor's default. A bearing within a zone comes from the light that spills into the
// neighbours; a sharper image takes it away, and 0 lets a marker show in zones far from it.
constexpr uint8_t SHARPENER_PERCENT = 5;
constexpr uint32_t BAUD = 460800;

// As the X-NUCLEO-53L8A1 wires its sensor.
constexpr uint32_t MOSI_PIN = D4, MISO_PIN = D5, CLOCK_PIN = D3, SELECT_PIN = D10;
constexpr uint32_t POWER_PIN = D11, LPN_PIN = A3, INTERRUPT_PIN = A2;

// The driver checks neither.
static_assert(ROWS == 4 || ROWS == 8, "the sensor has 4x4 or 8x8 zones");
static_assert(RATE_HZ <= (ROWS == 4 ? 60 : 15), "the sensor is not as fast");

constexpr uint8_t ZONES = ROWS * ROWS;
constexpr uint32_t FRAME_US = 1000000 / RATE_HZ;

static SPIClass bus(MOSI_PIN, MISO_PIN, CLOCK_PIN);
static VL53L8CX sensor(&bus, SELECT_PIN, LPN_PIN);
// Of 32 bits, and used by nothing else. It never stops, so it is the sensor's clock.
static HardwareTimer clock_us(TIM5);

static volatile uint32_t frames_made;
static volatile uint32_t made_at_us;

static void on_frame()
{
    made_at_us = clock_us.getCount();
    frames_made = frames_made + 1;
}

// What does not work will not by itself: say so for as long as someone may look.
static void require(uint8_t status, const char *what)
{
    while (status != VL53L8CX_STATUS_OK) {
        Serial.print("VL53L8CX: ");
        Serial.print(what);
        Serial.print(" failed; check the jumpers J7, J8 and J9 and the power\r\n");
        Serial.write(uint8_t{0}); // ends a packet, so the driver counts it as damaged
        digitalWrite(LED_BUILTIN, !digitalRead(LED_BUILTIN));
        delay(500);
    }
}

static bool is_ranging;

// Say who this is: to whoever listens at the start, and as the answer to every command.
static void identify()
{
    rl_identity identity = {{VERSION[0], VERSION[1], VERSION[2]}, is_ranging, {}};
    const uint32_t words[] = {HAL_GetUIDw0(), HAL_GetUIDw1(), HAL_GetUIDw2()};
    memcpy(identity.serial, words, sizeof words);
    uint8_t line[RL_IDENTITY_BYTES];
    Serial.write(line, rl_wire_encode_identity(&identity, line));
}

static void obey(const char *line)
{
    switch (rl_command_of(line)) {
    case RL_NO_COMMAND:
        return; // noise
    case RL_IDENTIFY:
        break;
    case RL_START:
        is_ranging = is_ranging || sensor.start_ranging() == VL53L8CX_STATUS_OK;
        break;
    case RL_STOP:
        is_ranging = is_ranging && sensor.stop_ranging() != VL53L8CX_STATUS_OK;
        break;
    case RL_RESET:
        is_ranging = true; // as it will be
        identify();
        Serial.flush();
        NVIC_SystemReset();
    }
    identify();
}

void setup()
{
    pinMode(LED_BUILTIN, OUTPUT);
    pinMode(POWER_PIN, OUTPUT);
    digitalWrite(POWER_PIN, HIGH);
    delay(10);
    Serial.begin(BAUD);

    clock_us.setPrescaleFactor(clock_us.getTimerClkFreq() / 1000000);
    clock_us.setOverflow(UINT32_MAX);
    clock_us.resume();

    bus.begin();
    sensor.begin();
    require(sensor.init(), "start");
    require(sensor.set_resolution(ZONES), "resolution"); // before the rate, whose meaning it sets
    require(sensor.set_ranging_frequency_hz(RATE_HZ), "rate");
    require(sensor.set_ranging_mode(VL53L8CX_RANGING_MODE_CONTINUOUS), "mode");
    // A dark marker must be able to fall behind the wall behind it.
    require(sensor.set_target_order(VL53L8CX_TARGET_ORDER_STRONGEST), "target order");
    require(sensor.set_sharpener_percent(SHARPENER_PERCENT), "sharpener");

    pinMode(INTERRUPT_PIN, INPUT_PULLUP);
    attachInterrupt(digitalPinToInterrupt(INTERRUPT_PIN), on_frame, FALLING);
    require(sensor.start_ranging(), "ranging");
    is_ranging = true;
    identify();
}

void loop()
{
    static VL53L8CX_ResultsData results;
    static rl_zone zones[ZONES];
    static uint8_t line[RL_WIRE_BYTES(ZONES)];
    static uint32_t frames_taken;
    static uint64_t now_us;
    static rl_line typed;

    while (Serial.available()) {
        if (rl_line_take(&typed, static_cast<char>(Serial.read()))) {
            obey(typed.text);
        }
    }
    noInterrupts();
    const uint32_t sequence = frames_made;
    const uint32_t at_us = made_at_us;
    interrupts();
    if (sequence == frames_taken) {
        return;
    }
    frames_taken = sequence;
    now_us = rl_extend_us(now_us, at_us);

    const uint8_t status = sensor.get_ranging_data(&results);
    // Whatever is dropped from here on leaves a gap in the sequence. A frame that was made while
    // this one was read may have replaced a part of it.
    if (status != VL53L8CX_STATUS_OK || frames_made != sequence) {
        return;
    }
    for (uint8_t i = 0; i < ZONES; i++) {
        const uint16_t target = VL53L8CX_NB_TARGET_PER_ZONE * i;
        zones[i] = rl_zone_of(results.nb_target_detected[i], results.distance_mm[target],
                              results.signal_per_spad[target], results.ambient_per_spad[i],
                              results.target_status[target]);
    }
    const rl_frame frame = {sequence, now_us - FRAME_US / 2, ROWS, zones};
    const size_t bytes = rl_wire_encode(&frame, line, sizeof line);
    // A line that is slower than the sensor loses whole frames.
    if (static_cast<size_t>(Serial.availableForWrite()) >= bytes) {
        Serial.write(line, bytes);
    }
}
