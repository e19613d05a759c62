// An interrupt comes at its instruction, though the program only computes.
// The handler reads SysTick first, which shows the delay since SysTick was 0: at most one cycle.
// handlers: 15 late
// slots: 0 1
  movs r1, #0
  keep r1, 0
  systick 999, 7
1: adds r4, #1
  muls r4, r4, r5
  b 1b
late:
  ldr r0, =0xE000E018
  ldr r1, [r0]
  rsb r1, r1, #1000
  load r2, 0x20070000
  cmp r1, r2
  it hi
  movhi r2, r1
  keep r2, 0
  bx lr
