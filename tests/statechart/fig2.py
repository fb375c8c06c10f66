"""Fig. 2 of the paper, literally: one state for each robot task and each assistance, and no counters."""


def literal_chart(num_tasks: int, num_joints: int) -> str:
    """The chart for M robot tasks and L joint actions, as SCXML."""
    tasks = "\n".join(
        f"""    <state id="a_{i}" pace:output="index = {i}">
      <transition pace:id="next_{i}" cond="done == 1 &amp;&amp; a == 0" target="a_{i % num_tasks + 1}">
        <assign location="started" expr="started + 1"/>
      </transition>
    </state>"""
        for i in range(1, num_tasks + 1)
    )
    assistances = "\n".join(
        f"""    <state id="before_A_{j}">
      <transition pace:id="go_{j}" cond="a == 1" target="A_{j}">
        <assign location="started" expr="started + 1"/>
      </transition>
      <transition pace:id="back_{j}" cond="a == 0" target="ROBOT_TASK_HISTORY"/>
    </state>
    <state id="A_{j}" pace:output="assisting = 1; index = {j}">
      <transition pace:id="done_{j}" cond="done == 1" target="{f"before_A_{j + 1}" if j < num_joints else "DONE"}"/>
    </state>"""
        for j in range(1, num_joints + 1)
    )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<!-- Fig. 2 of the paper, literally, for M = {num_tasks} robot tasks and L = {num_joints} joint actions: a_1 to a_M in
     ROBOT-TASK and A_1 to A_L in ASSISTING (each A_l is its preparation, joint action and homing), history both ways.
     Between two assistances the chart is in before_A_l, which is where a decision can follow an assistance directly.
     Made by tests/statechart/fig2.py; pace_task.scxml does the same with counters, and a test holds them equal. -->
<scxml xmlns="http://www.w3.org/2005/07/scxml" xmlns:pace="urn:pace-drake:statechart"
       version="1.0" name="fig2_literal" initial="ROBOT_TASK">
  <datamodel>
    <!-- Whether the last action that was started is done; the decision: -1 none yet, 0 go on, 1 assist. -->
    <data id="done" expr="0" pace:role="input" pace:type="boolean"/>
    <data id="a" expr="-1" pace:role="input" pace:type="integer"/>
    <!-- How many actions were started after the first. -->
    <data id="started" expr="0" pace:type="integer"/>
    <data id="assisting" expr="0" pace:role="output" pace:type="boolean"/>
    <data id="index" expr="0" pace:role="output" pace:type="integer"/>
  </datamodel>

  <state id="ROBOT_TASK" initial="a_1">
    <history id="ROBOT_TASK_HISTORY" type="deep"/>
    <transition pace:id="assist" cond="done == 1 &amp;&amp; a == 1" target="ASSISTING_HISTORY"/>
{tasks}
  </state>

  <state id="ASSISTING" initial="before_A_1">
    <history id="ASSISTING_HISTORY" type="deep"/>
{assistances}
  </state>

  <state id="DONE" pace:final="true"/>
</scxml>
"""
