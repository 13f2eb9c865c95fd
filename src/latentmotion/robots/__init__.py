"""Robots: descriptions of MuJoCo and URDF, and motions as angles of their hinges."""

from latentmotion.robots.description import Robot as Robot
from latentmotion.robots.description import read_robot as read_robot
from latentmotion.robots.retarget import RobotMotion as RobotMotion
from latentmotion.robots.retarget import check_output as check_output
from latentmotion.robots.retarget import retarget as retarget
from latentmotion.robots.retarget import write as write
