#!/bin/bash
bash bin/register OAK
