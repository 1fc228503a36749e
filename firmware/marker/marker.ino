// Copyright 2026 retrolidar_ros contributors
// SPDX-License-Identifier: Apache-2.0
//
// The marker, on a NUCLEO-L031K6 or another small STM32: two pins to the driver of the liquid
// crystal, the comparator's output, and a pin that powers the amplifiers.
//
// Libraries: STM32duino Low Power 1.4.0 with STM32duino RTC 1.8.0, and ../core.

#include <EEPROM.h>
#include <STM32LowPower.h>
#include <retrolidar_command.h>
#include <retrolidar_drive.h>
#include <retrolidar_wakeup.h>

constexpr uint16_t DEFAULT_ID = 2073; // until another is set: type "id 7" within LISTEN_MS of a reset
constexpr uint32_t BIT_US = 42000;    // two frames of the sensor
constexpr uint32_t HALF_PERIOD_US = 500; // well below the 3.5 ms in which the crystal brightens
constexpr uint16_t PACKETS = 2;          // each time that it wakes

constexpr uint32_t FIRST_PIN = D9, SECOND_PIN = D10; // electrodes, through drivers of 5 V
constexpr uint32_t FRONTEND_PIN = D3;                // powers photodiode, amplifiers, comparator
constexpr uint32_t LIGHT_PIN = D2;                   // comparator; tied high, the marker always sends

// The comparator is asked every SAMPLE_US of a look. Its circuit needs 0.4 ms to answer, so of 20
// samples 12 can be high.
constexpr uint32_t SAMPLE_US = 50;
constexpr rl_wakeup_settings WAKEUP = {
    99000, // sleep [us]
    1000,  // look [us]
    6,     // samples with light that wake
    3,     // so many fewer keep it awake
};

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
    char line[16];
    uint8_t length = 0;
    Serial.begin(CONSOLE_BAUD);
    Serial.print("RetroLiDAR marker, id ");
    Serial.print(id);
    Serial.print("\r\n");
    for (uint32_t last_ms = millis(); millis() - last_ms < LISTEN_MS;) {
        if (!Serial.available()) {
            continue;
        }
        last_ms = millis();
        const char typed = static_cast<char>(Serial.read());
        if (typed != '\r' && typed != '\n') {
            // What is too long for the line is none of the commands, and stays so.
            line[length] = typed;
            length += length < sizeof line - 1;
        } else if (length > 0) {
            line[length] = '\0';
            length = 0;
            obey(line);
        }
    }
    Serial.end();
}

static void look()
{
    uint16_t lit = 0;
    digitalWrite(FRONTEND_PIN, HIGH);
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
    pinMode(LIGHT_PIN, INPUT);
    load_id();
    listen();

    LowPower.begin();
    half_period.pause();
    half_period.setOverflow(HALF_PERIOD_US, MICROSEC_FORMAT);
    half_period.attachInterrupt(on_half_period);
    rl_wakeup_start(&wakeup, &WAKEUP);
}

void loop()
{
    switch (wakeup.mode) {
    case RL_SLEEP:
        LowPower.deepSleep(WAKEUP.sleep_us / 1000);
        rl_wakeup_step(&wakeup, WAKEUP.sleep_us, 0);
        break;
    case RL_DETECT:
        look();
        break;
    case RL_TRANSMIT:
        send();
        break;
    }
}
