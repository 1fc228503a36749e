// Copyright 2026 retrolidar_ros contributors
// SPDX-License-Identifier: Apache-2.0
//
// The marker, on a NUCLEO-L031K6: two pins to the driver of the liquid crystal, the comparator's
// output, and a pin that powers the amplifiers.
//
// Libraries: STM32duino Low Power 1.5.0 with STM32duino RTC 1.9.0, and ../core.

#include <EEPROM.h>
#include <IWatchdog.h>
#include <STM32LowPower.h>
#include <retrolidar_command.h>
#include <retrolidar_marker.h>

constexpr uint16_t DEFAULT_ID = 2073; // until another is set: type "id 7" within LISTEN_MS of a reset
constexpr uint32_t BIT_US = 42000;    // two frames of the sensor
constexpr uint32_t HALF_PERIOD_US = 500; // well below the 3.5 ms in which the crystal brightens
constexpr uint16_t PACKETS = 2;          // each time that it wakes

constexpr uint32_t FIRST_PIN = D9, SECOND_PIN = D10; // electrodes, through drivers of 5 V
constexpr uint32_t FRONTEND_PIN = D3;                // powers photodiode, amplifiers, comparator
constexpr uint32_t LIGHT_PIN = D2;                   // comparator; tied high, the marker always sends

// A look of 1 ms begins with what the circuit needs to come up and to answer; what it says until then
// tells nothing. Then the comparator is asked every SAMPLE_US.
constexpr uint32_t SETTLE_US = 400;
constexpr uint32_t SAMPLE_US = 50;
constexpr rl_wakeup_settings WAKEUP = {
    99000, // sleep [us]
    600,   // look [us]: 12 samples
    6,     // samples with light that wake
    3,     // so many fewer keep it awake
};
// A program that hangs in a dark bit would leave direct voltage on the crystal. Sleeps are shorter.
constexpr uint32_t WATCHDOG_US = 2000000;

constexpr uint32_t CONSOLE_BAUD = 115200;
constexpr uint32_t LISTEN_MS = 5000;

constexpr uint16_t TICKS_PER_BIT = BIT_US / HALF_PERIOD_US;
static_assert(BIT_US % (2 * HALF_PERIOD_US) == 0, "a bit must hold whole periods, or DC remains");
static_assert(WAKEUP.hysteresis < WAKEUP.threshold, "or it would stay awake in the dark");

static HardwareTimer half_period(TIM2);
static rl_drive drive;
static rl_wakeup wakeup;
static uint16_t id;
static volatile bool sending;

// The library waits for 10 ms, at full speed, after every deep sleep: ten times as long as a look.
// Nothing else that is used here waits in this way.
extern "C" void HAL_Delay(uint32_t) {}

// The pin that goes low goes first: both high would short nothing, but both low is the rest state.
static void on_half_period()
{
    switch (rl_drive_tick(&drive)) {
    case RL_FIRST_HIGH:
        digitalWrite(SECOND_PIN, LOW);
        digitalWrite(FIRST_PIN, HIGH);
        break;
    case RL_SECOND_HIGH:
        digitalWrite(FIRST_PIN, LOW);
        digitalWrite(SECOND_PIN, HIGH);
        break;
    case RL_SHORTED:
        digitalWrite(FIRST_PIN, LOW);
        digitalWrite(SECOND_PIN, LOW);
        break;
    }
    sending = drive.busy;
}

static void load_id()
{
    EEPROM.get(0, id);
    if (!rl_id_is_usable(id)) { // as the memory of a new chip
        id = DEFAULT_ID;
    }
}

static void obey(const char *line)
{
    const uint16_t wanted = rl_command_id(line);
    if (wanted == 0) {
        Serial.print("not understood; an ID is set by, for example: id 7 (1 to 4094)\r\n");
        return;
    }
    id = wanted;
    EEPROM.put(0, id);
    Serial.print("id ");
    Serial.print(id);
    Serial.print(" is kept\r\n");
}

// Take commands until nobody has typed for LISTEN_MS.
static void listen()
{
    rl_line line = {};
    Serial.begin(CONSOLE_BAUD);
    Serial.print("RetroLiDAR marker, id ");
    Serial.print(id);
    Serial.print("\r\n");
    for (uint32_t last_ms = millis(); millis() - last_ms < LISTEN_MS;) {
        if (!Serial.available()) {
            continue;
        }
        last_ms = millis();
        if (rl_line_take(&line, static_cast<char>(Serial.read()))) {
            obey(line.text);
        }
    }
    Serial.end();
}

static void look()
{
    uint16_t lit = 0;
    digitalWrite(FRONTEND_PIN, HIGH);
    delayMicroseconds(SETTLE_US);
    do {
        delayMicroseconds(SAMPLE_US);
        lit += digitalRead(LIGHT_PIN) == HIGH;
    } while (rl_wakeup_step(&wakeup, SAMPLE_US, lit) == RL_DETECT);
    digitalWrite(FRONTEND_PIN, LOW);
}

static void send()
{
    sending = rl_drive_start(&drive, id, PACKETS, TICKS_PER_BIT);
    half_period.setCount(0);
    half_period.resume();
    while (sending) {
        IWatchdog.reload();
        __WFI(); // until the next interrupt
    }
    half_period.pause();
    rl_wakeup_sent(&wakeup);
}

void setup()
{
    for (const uint32_t pin : {FIRST_PIN, SECOND_PIN, FRONTEND_PIN}) {
        pinMode(pin, OUTPUT);
        digitalWrite(pin, LOW);
    }
    pinMode(LIGHT_PIN, INPUT_PULLDOWN); // no circuit, no light
    load_id();
    listen();

    LowPower.begin();
    half_period.pause();
    half_period.setOverflow(HALF_PERIOD_US, MICROSEC_FORMAT);
    half_period.attachInterrupt(on_half_period);
    rl_wakeup_start(&wakeup, &WAKEUP);
    IWatchdog.begin(WATCHDOG_US);
}

static void sleep_until_next_look()
{
    // The tick would end it at once where a debugger has left the clocks running.
    HAL_SuspendTick();
    LowPower.deepSleep(WAKEUP.sleep_us / 1000);
    HAL_ResumeTick();
    rl_wakeup_step(&wakeup, WAKEUP.sleep_us, 0);
}

void loop()
{
    IWatchdog.reload();
    switch (wakeup.mode) {
    case RL_SLEEP:
        sleep_until_next_look();
        break;
    case RL_DETECT:
        look();
        break;
    case RL_TRANSMIT:
        send();
        break;
    }
}
