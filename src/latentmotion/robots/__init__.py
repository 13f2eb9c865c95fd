"""Robots: descriptions of MuJoCo and URDF, and motions as angles of their hinges."""

from latentmotion.robots.description import Robot as Robot
from latentmotion.robots.description import read_robot as read_robot
from latentmotion.robots.hinges import RobotMotion as RobotMotion
from latentmotion.robots.hinges import check_output as check_output
from latentmotion.robots.hinges import retarget as retarget
from latentmotion.robots.hinges import write as write
