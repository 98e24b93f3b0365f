/* A loop of 100 Hz: every 10 ms the policy reads the state and sets the inputs, which are held until the next tick.

   cc -std=c99 -O2 loop_100hz.c hfa_aircraft.c -lm -o loop_100hz && ./loop_100hz

   Here the aircraft is simulated, by steps of 1 ms from 1 ft/s too fast; on a flight computer `sense` reads the
   sensors, `act` sets the servos, and a timer calls `tick`. What that takes is in `size hfa_aircraft.o`: no heap, no
   data that is written, and some hundred bytes of stack. */
#include "hfa_aircraft.h"

#include <stdio.h>

static double flown[HFA_STATES], held[HFA_INPUTS];

static void sense(double *x)
{
    for (int i = 0; i < HFA_STATES; i++) x[i] = flown[i];
}

static void act(const double *u)
{
    for (int i = 0; i < HFA_INPUTS; i++) held[i] = u[i];
}

static void tick(void)
{
    double x[HFA_STATES], u[HFA_INPUTS];
    sense(x);
    hfa_policy(x, u);
    act(u);
}

int main(void)
{
    for (int i = 0; i < HFA_STATES; i++) flown[i] = hfa_x0[i];
    flown[HFA_SPEED] += 1.0;
    for (int count = 0; count < 2000; count++) {
        tick();
        for (int step = 0; step < 10; step++) hfa_step(flown, held, 0.0, 0.001);
    }
    for (int i = 0; i < HFA_STATES; i++)
        printf("%-32s %.17g %s\n", hfa_state_name[i], flown[i], hfa_state_unit[i]);
    return 0;
}
